/* Light on thick paint: hertzmann2002fast. The specification is the compiled Python in emboss.py; same operations, same
 * order, so that both round alike.
 *
 * A canvas is h rows of w pixels of `channels` floats: red, green, blue, height of paint, and what is of no matter here.
 */

/* Height of the surface, px: paint, and the weave as far as paint has not filled it. */
static float level(global const float *canvas, global const float *cloth, const float weave_px, int x, int y,
                   const int channels, const int width, const int height)
{
    x = clamp(x, 0, width - 1);
    y = clamp(y, 0, height - 1);
    const float paint = canvas[(y * width + x) * channels + 3];
    return paint + weave_px * cloth[(y & 63) * 64 + (x & 63)] / (1.0f + paint + paint);
}

kernel void emboss(global const float *canvas, global const float *cloth, global uchar *out, const float lx,
                   const float ly, const float strength, const float gloss, const float weave_px, const int channels,
                   const int width, const int height)
{
    const int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height)
        return;
#define LEVEL(X, Y) level(canvas, cloth, weave_px, X, Y, channels, width, height)
    const float rise_x = (LEVEL(x + 1, y) - LEVEL(x - 1, y)) * 0.5f;
    const float rise_y = (LEVEL(x, y + 1) - LEVEL(x, y - 1)) * 0.5f;
    const float slope = -(rise_x * lx + rise_y * ly);
    const float shade = min(max(1.0f + strength * slope, 0.5f), 1.6f);
    const float shine = gloss * max(slope - 0.2f, 0.0f) * 255.0f;
    const int here = y * width + x;
    for (int c = 0; c < 3; c++) {
        const float value = canvas[here * channels + c] * shade + min(shine, 70.0f) + 0.5f;
        out[here * 3 + c] = (uchar)min(max(value, 0.0f), 255.0f);
    }
}

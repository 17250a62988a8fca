/* Offset fields: made, moved, refined, merged and shown. The specification is reference.py.

   Compile-time: RADIUS, CHANNELS, COLOURS (3, or 4 with opacity), PAD (of the style image), ROTATE, HOLES. */

static int usable(const int2 at, global const uchar *holes, const int style_width, const int style_height)
{
    if (at.x < 0 || at.y < 0 || at.x >= style_width || at.y >= style_height)
        return 0;
#if HOLES
    return holes[at.y * style_width + at.x] != 0;
#else
    return 1;
#endif
}

/* A random place of the style: eight tries, then the first one there is. */
static float2 anywhere(const int x, const int y, const uint seed, const uint stream, global const uchar *holes,
                       const int2 first, const int style_width, const int style_height)
{
    for (int k = 0; k < 8; k++) {
        const uint4 words = philox((uint4)(x, y, k, 0x5CA77E12u), (uint2)(seed, stream));
        const int2 at = clamped((int2)((int)(unit(words.x) * style_width), (int)(unit(words.y) * style_height)),
                               style_width, style_height);
        if (usable(at, holes, style_width, style_height))
            return convert_float2(at);
    }
    return convert_float2(first);
}

kernel void random_offsets(
    global float2 *offsets /* height * width */,
    global const uchar *holes /* HOLES * style_height * style_width */, const uint seed, const uint stream,
    const int first_x, const int first_y, const int style_width, const int style_height, const int width,
    const int height)
{
    const int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height)
        return;
    offsets[y * width + x] =
        anywhere(x, y, seed, stream, holes, (int2)(first_x, first_y), style_width, style_height);
}

/* Colours of the offsets into the target's first COLOURS channels, and the rounded offsets, both with a margin of
   RADIUS px: beyond the frame each border pixel's texture goes on. */
kernel void render(
    global const float2 *offsets /* height * width */, global const uchar *bins /* ROTATE * height * width */,
    global const uchar *style /* (style_height + 2 * PAD) * (style_width + 2 * PAD) * CHANNELS */,
    global const uchar *style_bins /* ROTATE * style_height * style_width */, constant float2 *cosines /* 64 */,
    global uchar *target /* (height + 2 * RADIUS) * (width + 2 * RADIUS) * CHANNELS */,
    global short2 *field /* (height + 2 * RADIUS) * (width + 2 * RADIUS) */, const int style_width,
    const int style_height, const int width, const int height)
{
    const int x = get_global_id(0), y = get_global_id(1), stride = width + 2 * RADIUS;
    if (x >= stride || y >= height + 2 * RADIUS)
        return;
    const int2 here = (int2)(x - RADIUS, y - RADIUS), inside = clamped(here, width, height);
    const int index = inside.y * width + inside.x;
    float2 offset = offsets[index];
    if (here.x != inside.x || here.y != inside.y)
        offset = extrapolated_offset(offset, convert_float2(here - inside), ROTATE ? bins[index] : 255, style_bins, cosines,
                         style_width, style_height);
    const int2 at = rounded(offset), shown = clamped(at, style_width, style_height);
    global const uchar *from = style + ((shown.y + PAD) * (style_width + 2 * PAD) + shown.x + PAD) * CHANNELS;
    global uchar *to = target + (y * stride + x) * CHANNELS;
    for (int c = 0; c < COLOURS; c++)
        to[c] = from[c];
    field[y * stride + x] = convert_short2(at);
}

/* How often each pixel of the style is shown: eq. 8's histogram. Integers, so that order does not matter. */
kernel void count(
    global const float2 *offsets /* height * width */,
    volatile global int *counts /* style_height * style_width */, const int style_width, const int style_height,
    const int width, const int height)
{
    const int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height)
        return;
    const int2 at = clamped(rounded(offsets[y * width + x]), style_width, style_height);
    atomic_inc(counts + at.y * style_width + at.x);
}

/* Binomial 1 6 15 20 15 6 1 over 64 along x; the second pass is along y. */
kernel void blur_counts(
    global const int *counts /* height * width */, global float *out /* height * width */, const int width,
    const int height)
{
    const int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height)
        return;
    global const int *row = counts + y * width;
    const int last = width - 1;
    out[y * width + x] = (float)(20 * row[x] + 15 * (row[max(x - 1, 0)] + row[min(x + 1, last)])
                                 + 6 * (row[max(x - 2, 0)] + row[min(x + 2, last)])
                                 + row[max(x - 3, 0)] + row[min(x + 3, last)]);
}

/* The penalty of eq. 8 for each pixel of the style. */
kernel void histogram_penalty(
    global const float *rows /* height * width */, global float *out /* height * width */,
    const float threshold, const float slope, const int width, const int height)
{
    const int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height)
        return;
    const int last = height - 1;
    const float sum = 20.0f * rows[y * width + x]
                      + 15.0f * (rows[max(y - 1, 0) * width + x] + rows[min(y + 1, last) * width + x])
                      + 6.0f * (rows[max(y - 2, 0) * width + x] + rows[min(y + 2, last) * width + x])
                      + (rows[max(y - 3, 0) * width + x] + rows[min(y + 3, last) * width + x]);
    out[y * width + x] = slope * fmax(0.0f, sum * 2.44140625e-4f - threshold);
}

/* The other frame's offsets, carried here: nearest sample, then extrapolated; NOWHERE where nothing came from. */
kernel void advect(
    global const float2 *offsets /* height * width */, global const uchar *bins /* ROTATE * height * width */,
    global const float2 *displacement /* height * width */, global const uchar *visible /* height * width */,
    global const uchar *style_bins /* ROTATE * style_height * style_width */, constant float2 *cosines /* 64 */,
    global const uchar *holes /* HOLES * style_height * style_width */, global float2 *out /* height * width */,
    const int style_width, const int style_height, const int width, const int height)
{
    const int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height)
        return;
    const int here = y * width + x;
    const float2 from = (float2)(x, y) + displacement[here];
    const int2 near = rounded(from);
    float2 found = (float2)(NOWHERE);
    if (visible[here] && near.x >= 0 && near.y >= 0 && near.x < width && near.y < height) {
        const int index = near.y * width + near.x;
        if (offsets[index].x > NOWHERE)
            found = extrapolated_offset(offsets[index], from - convert_float2(near), ROTATE ? bins[index] : 255, style_bins,
                            cosines, style_width, style_height);
        if (!usable(rounded(found), holes, style_width, style_height))
            found = (float2)(NOWHERE);
    }
    out[here] = found;
}

/* A coarser level's offsets at twice the size, extrapolated from the nearest sample. Style sizes are the coarse one's
   for the directions and the fine one's for what may be used. */
kernel void upsample(
    global const float2 *coarse /* coarse_height * coarse_width */,
    global const uchar *bins /* ROTATE * coarse_height * coarse_width */,
    global const uchar *style_bins /* ROTATE * coarse_style_height * coarse_style_width */,
    constant float2 *cosines /* 64 */, global const uchar *holes /* HOLES * style_height * style_width */,
    global float2 *out /* height * width */, const int coarse_style_width, const int coarse_style_height,
    const int coarse_width, const int coarse_height, const int style_width, const int style_height,
    const int width, const int height)
{
    const int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height)
        return;
    const float2 from = ((float2)(x, y) + 0.5f) * 0.5f - 0.5f;
    const int2 near = clamped((int2)(x / 2, y / 2), coarse_width, coarse_height);
    const int index = near.y * coarse_width + near.x;
    const float2 offset = coarse[index];
    float2 found = (float2)(NOWHERE);
    if (offset.x > NOWHERE) {
        found = extrapolated_offset(offset, from - convert_float2(near), ROTATE ? bins[index] : 255, style_bins, cosines,
                        coarse_style_width, coarse_style_height) * 2.0f + 0.5f;
        if (!usable(rounded(found), holes, style_width, style_height))
            found = offset * 2.0f;
        if (!usable(rounded(found), holes, style_width, style_height))
            found = (float2)(NOWHERE);
    }
    out[y * width + x] = found;
}

/* Of two fields, each pixel's offset from the first with probability `share`; what is nowhere in one is taken from
   the other, and anywhere where it is nowhere in both. */
kernel void merge(
    global const float2 *first /* height * width */, global const float2 *second /* height * width */,
    global const uchar *holes /* HOLES * style_height * style_width */, global float2 *out /* height * width */,
    const float share, const uint seed, const uint stream, const int first_x, const int first_y,
    const int style_width, const int style_height, const int width, const int height)
{
    const int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height)
        return;
    const float2 a = first[y * width + x], b = second[y * width + x];
    const uint4 words = philox((uint4)(x, y, 0, 0x3E26E000u), (uint2)(seed, stream));
    float2 taken = b.x <= NOWHERE || (a.x > NOWHERE && unit(words.x) < share) ? a : b;
    if (taken.x <= NOWHERE)
        taken = anywhere(x, y, seed, stream, holes, (int2)(first_x, first_y), style_width, style_height);
    out[y * width + x] = taken;
}

/* What the pixels looked like before: the advected offsets' colours, and whether there are any. */
kernel void colours_at(
    global const float2 *offsets /* height * width */,
    global const uchar *style /* (style_height + 2 * PAD) * (style_width + 2 * PAD) * CHANNELS */,
    global uchar4 *out /* height * width */, const int style_width, const int style_height, const int width,
    const int height)
{
    const int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height)
        return;
    const float2 offset = offsets[y * width + x];
    const int2 at = clamped(rounded(offset), style_width, style_height);
    global const uchar *from = style + ((at.y + PAD) * (style_width + 2 * PAD) + at.x + PAD) * CHANNELS;
    out[y * width + x] = (uchar4)(from[0], from[1], from[2], offset.x > NOWHERE ? 255 : 0);
}

/* Offsets that are given (painted pixels) over those that were found. */
kernel void impose(
    global const float2 *given /* height * width */, global float2 *offsets /* height * width */,
    const int width, const int height)
{
    const int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height)
        return;
    if (given[y * width + x].x > NOWHERE)
        offsets[y * width + x] = given[y * width + x];
}

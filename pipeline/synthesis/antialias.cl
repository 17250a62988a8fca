/* Anti-aliased rendering of offset fields. The specification is antialias.py: the same operations in the same order.

   Macros: COLOURS of the style (3, or 4 with opacity), STEP_BITS of the fraction of a position and STEPS
   (1 << STEP_BITS), ROTATE (1 = pieces are rotated), PARTIAL (1 = some pixels may not be painted). */

/* Adds a colour of the style, whose fourth channel is its opacity (1 without opacity, or 0..255), times `share`. */
static float4 added(const float4 total, const float4 colour, const float share)
{
#if COLOURS == 4
    return total + share * (colour.w / 255.0f) * (float4)(colour.xyz, 1.0f);
#else
    return total + share * colour;
#endif
}

/* Four neighbouring colours of a row of the style, from x on; its last pixels are repeated beyond the row. */
static float16 four_colours(global const uchar4 *row, const int x, const int style_width)
{
    if (x >= 0 && x + 3 < style_width)
        return convert_float16(vload16(0, (global const uchar *)(row + x)));
    const int last = style_width - 1;
    return convert_float16((uchar16)(row[clamp(x, 0, last)], row[clamp(x + 1, 0, last)], row[clamp(x + 2, 0, last)],
                                     row[clamp(x + 3, 0, last)]));
}

/* Adds a sample of the style at the position `at`, in steps, times `weight`: colours times opacity in xyz, opacity
   (0..1) in w. */
static float4 sampled(float4 total, global const uchar4 *colours, constant float4 *taps, const int2 at,
                      const float weight, const int style_width, const int style_height)
{
    const int2 pixel = at >> STEP_BITS, fraction = at & (STEPS - 1);
    if (fraction.x == 0 && fraction.y == 0) {
        const int2 inside = clamped(pixel, style_width, style_height);
        return added(total, convert_float4(colours[inside.y * style_width + inside.x]), weight);
    }
    const float4 along_x = taps[fraction.x], along_y = taps[fraction.y];
    const float rows[4] = {along_y.x, along_y.y, along_y.z, along_y.w};
    for (int j = 0; j < 4; j++) {
        const int y = clamp(pixel.y + j - 1, 0, style_height - 1);
        const float16 four = four_colours(colours + y * style_width, pixel.x - 1, style_width);
        const float4 shares = weight * rows[j] * along_x;
        total = added(total, four.lo.lo, shares.x);
        total = added(total, four.lo.hi, shares.y);
        total = added(total, four.hi.lo, shares.z);
        total = added(total, four.hi.hi, shares.w);
    }
    return total;
}

/* Each pixel is the mean of the colours that its own piece and those of its eight neighbours show there, weighted
   1 2 1 along x and y. */
__attribute__((vec_type_hint(float4))) kernel void
antialias(
    global const float2 *offsets /* height * width */, global const uchar *bins /* ROTATE * height * width */,
    global const uchar *style_bins /* ROTATE * style_height * style_width */, constant float2 *cosines /* 64 */,
    constant float4 *taps /* STEPS */, global const uchar4 *colours /* style_height * style_width */,
    global const uchar *paintable /* PARTIAL * height * width */, global uchar *out /* height * width * COLOURS */,
    const int style_width, const int style_height, const int width, const int height)
{
    const int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height)
        return;
    const int here = y * width + x;
    const int2 own = convert_int2_rte(offsets[here] * (float)STEPS);
    float4 total = (float4)(0.0f);
    float own_weight = 4.0f, weights = 0.0f;
    for (int dy = -1; dy <= 1; dy++)
        for (int dx = -1; dx <= 1; dx++) {
            const int nx = x + dx, ny = y + dy;
            if ((dx == 0 && dy == 0) || nx < 0 || nx >= width || ny < 0 || ny >= height)
                continue;
            const int other = ny * width + nx;
#if PARTIAL
            if (!paintable[other])
                continue;
#endif
            const float weight = dx && dy ? 1.0f : 2.0f;
            const float2 offset =
                extrapolated_offset(offsets[other], (float2)(-dx, -dy), ROTATE ? bins[other] : 255, style_bins,
                                    cosines, style_width, style_height);
            const int2 at = convert_int2_rte(offset * (float)STEPS);
            if (at.x == own.x && at.y == own.y)
                own_weight += weight;
            else {
                total = sampled(total, colours, taps, at, weight, style_width, style_height);
                weights += weight;
            }
        }
    total = sampled(total, colours, taps, own, own_weight, style_width, style_height);
    const float4 mean = clamp(total / fmax(total.w, 1.0e-6f), 0.0f, 255.0f);
    const uchar4 rounded_mean = convert_uchar4_rte(mean);
    global uchar *to = out + here * COLOURS;
    to[0] = rounded_mean.x;
    to[1] = rounded_mean.y;
    to[2] = rounded_mean.z;
#if COLOURS == 4
    to[3] = convert_uchar_rte(255.0f * clamp(total.w / (weights + own_weight), 0.0f, 1.0f));
#endif
}

/* Operations on offset fields: random initialisation, rendering, advection, upsampling, merging. The specification is
   reference.py.

   Macros: RADIUS of the patch, CHANNELS per pixel, COLOURS (3, or 4 with opacity), GUIDES (channels), PAD (margin of the
   style image, px), ROTATE (1 = patches rotate), MASKED (1 = some style pixels must not be used), VOTES (1 = `render`
   averages the colours of overlapping patches), BIASED (1 = `merge` has a probability for each pixel). */

static int usable(const int2 at, global const uchar *usable_mask, const int style_width, const int style_height)
{
    if (at.x < 0 || at.y < 0 || at.x >= style_width || at.y >= style_height)
        return 0;
#if MASKED
    return usable_mask[at.y * style_width + at.x] != 0;
#else
    return 1;
#endif
}

/* A random usable position of the style: at most eight tries, then the first usable one. */
static float2 random_position(const int x, const int y, const uint seed, const uint stream,
                              global const uchar *usable_mask, const int2 first, const int style_width,
                              const int style_height)
{
    for (int k = 0; k < 8; k++) {
        const uint4 words = philox((uint4)(x, y, k, 0x5CA77E12u), (uint2)(seed, stream));
        const int2 at = clamped((int2)((int)(unit(words.x) * style_width), (int)(unit(words.y) * style_height)),
                               style_width, style_height);
        if (usable(at, usable_mask, style_width, style_height))
            return convert_float2(at);
    }
    return convert_float2(first);
}

kernel void random_offsets(
    global float2 *offsets /* height * width */,
    global const uchar *usable_mask /* MASKED * style_height * style_width */, const uint seed, const uint stream,
    const int first_x, const int first_y, const int style_width, const int style_height, const int width,
    const int height)
{
    const int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height)
        return;
    offsets[y * width + x] =
        random_position(x, y, seed, stream, usable_mask, (int2)(first_x, first_y), style_width, style_height);
}

/* The pixel of the padded style at which a patch of the frame shows the pixel at distance `step` from its centre. */
static global const uchar *shown(global const float2 *offsets, global const uchar *bins, const int index,
                                 const int2 step, global const uchar *style, global const uchar *style_bins,
                                 constant float2 *cosines, const int style_width, const int style_height)
{
    const float2 offset = extrapolated_offset(offsets[index], convert_float2(step), ROTATE ? bins[index] : 255,
                                              style_bins, cosines, style_width, style_height);
    const int2 at = clamped(rounded(offset), style_width, style_height);
    return style + ((at.y + PAD) * (style_width + 2 * PAD) + at.x + PAD) * CHANNELS;
}

/* Writes the style colours at the offsets into the first COLOURS channels of the target, and the rounded offsets into
   the field. Both have a margin of RADIUS px, which continues the texture of the border pixels. With VOTES, a colour is
   the mean of the colours that every second patch around the pixel, along x and y, shows there. */
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
        offset = extrapolated_offset(offset, convert_float2(here - inside), ROTATE ? bins[index] : 255, style_bins,
                                     cosines, style_width, style_height);
    const int2 at = rounded(offset);
    global uchar *to = target + (y * stride + x) * CHANNELS;
#if VOTES
    uint even = 0, odd = 0; /* sums of the even and the odd channels, two of 16 bits each */
    for (int dy = -RADIUS; dy <= RADIUS; dy += 2)
        for (int dx = -RADIUS; dx <= RADIUS; dx += 2) {
            const int2 centre = clamped(here + (int2)(dx, dy), width, height);
            const uint four = *(global const uint *)shown(offsets, bins, centre.y * width + centre.x, here - centre,
                                                          style, style_bins, cosines, style_width, style_height);
            even += four & 0x00FF00FFu;
            odd += (four >> 8) & 0x00FF00FFu;
        }
    const uint count = (RADIUS + 1) * (RADIUS + 1);
    for (int c = 0; c < COLOURS; c++)
        to[c] = ((((c & 1 ? odd : even) >> (c & 2 ? 16 : 0)) & 0xFFFFu) + count / 2) / count;
#else
    const int2 nearest = clamped(at, style_width, style_height);
    global const uchar *from = style + ((nearest.y + PAD) * (style_width + 2 * PAD) + nearest.x + PAD) * CHANNELS;
    for (int c = 0; c < COLOURS; c++)
        to[c] = from[c];
#endif
    field[y * stride + x] = convert_short2(at);
}

/* Adds a share of the change of eq. 10 to the guides of the target, in place: the difference between the style at the
   advected offset and the neighbouring frame. Three squares with a common variable equal one square plus a constant, so
   that a patch compared with these guides costs as much as with eq. 3 alone. */
kernel void add_change(
    global const float2 *advected /* height * width */, global const uchar *neighbour /* height * width * GUIDES */,
    global const uchar *visible /* height * width */,
    global const uchar *style /* (style_height + 2 * PAD) * (style_width + 2 * PAD) * CHANNELS */,
    constant short *change_fraction /* CHANNELS */,
    global uchar *target /* (height + 2 * RADIUS) * (width + 2 * RADIUS) * CHANNELS */, const int style_width,
    const int style_height, const int width, const int height)
{
    const int x = get_global_id(0), y = get_global_id(1), stride = width + 2 * RADIUS;
    if (x >= stride || y >= height + 2 * RADIUS)
        return;
    const int2 inside = clamped((int2)(x - RADIUS, y - RADIUS), width, height);
    const int index = inside.y * width + inside.x;
    const float2 offset = advected[index];
    if (!visible[index] || offset.x <= NOWHERE)
        return;
    const int2 at = clamped(rounded(offset), style_width, style_height);
    global const uchar *from =
        style + ((at.y + PAD) * (style_width + 2 * PAD) + at.x + PAD) * CHANNELS + COLOURS;
    global uchar *to = target + (y * stride + x) * CHANNELS + COLOURS;
    for (int c = 0; c < GUIDES; c++) {
        const int change = (int)from[c] - neighbour[index * GUIDES + c];
        to[c] = clamp(to[c] + ((change * change_fraction[COLOURS + c] + 64) >> 7), 0, 255);
    }
}

/* Counts the uses of each style pixel: the histogram of eq. 8. Integers, so that the order does not matter. */
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

/* Filters with the binomial kernel 1 6 15 20 15 6 1 along x. `histogram_penalty` does the pass along y; each has a sum
   of 64. */
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

/* The penalty of eq. 8 for each style pixel: slope times the blurred number of uses in excess of the threshold. */
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

/* Advects the offsets of another frame to this one: nearest sample, then extrapolated. NOWHERE at pixels that are not
   visible in the other frame. */
kernel void advect(
    global const float2 *offsets /* height * width */, global const uchar *bins /* ROTATE * height * width */,
    global const float2 *displacement /* height * width */, global const uchar *visible /* height * width */,
    global const uchar *style_bins /* ROTATE * style_height * style_width */, constant float2 *cosines /* 64 */,
    global const uchar *usable_mask /* MASKED * style_height * style_width */, global float2 *out /* height * width */,
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
            found = extrapolated_offset(offsets[index], from - convert_float2(near), ROTATE ? bins[index] : 255,
                                        style_bins, cosines, style_width, style_height);
        if (!usable(rounded(found), usable_mask, style_width, style_height))
            found = (float2)(NOWHERE);
    }
    out[here] = found;
}

/* Upsamples the offsets of the next coarser level by 2, extrapolated from the nearest sample. `style_bins` has the size
   of the coarse style, `usable_mask` that of the fine style. */
kernel void upsample_offsets(
    global const float2 *coarse /* coarse_height * coarse_width */,
    global const uchar *bins /* ROTATE * coarse_height * coarse_width */,
    global const uchar *style_bins /* ROTATE * coarse_style_height * coarse_style_width */,
    constant float2 *cosines /* 64 */, global const uchar *usable_mask /* MASKED * style_height * style_width */,
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
        found = extrapolated_offset(offset, from - convert_float2(near), ROTATE ? bins[index] : 255, style_bins,
                                    cosines, coarse_style_width, coarse_style_height) * 2.0f + 0.5f;
        if (!usable(rounded(found), usable_mask, style_width, style_height))
            found = offset * 2.0f;
        if (!usable(rounded(found), usable_mask, style_width, style_height))
            found = (float2)(NOWHERE);
    }
    out[y * width + x] = found;
}

/* Random merge: the offset of the first field with the given probability, otherwise of the second. If only one of the
   two has an offset, that one is used; if neither has one, a random position. With BIASED, each pixel has a probability
   of its own. */
kernel void merge(
    global const float2 *first /* height * width */, global const float2 *second /* height * width */,
    global const uchar *usable_mask /* MASKED * style_height * style_width */, global float2 *out /* height * width */,
    global const float *probabilities /* BIASED * height * width */, const float same_probability, const uint seed, const uint stream, const int first_x, const int first_y,
    const int style_width, const int style_height, const int width, const int height)
{
    const int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height)
        return;
    const float2 a = first[y * width + x], b = second[y * width + x];
    const float probability = BIASED ? probabilities[y * width + x] : same_probability;
    const uint4 words = philox((uint4)(x, y, 0, 0x3E26E000u), (uint2)(seed, stream));
    float2 merged = b.x <= NOWHERE || (a.x > NOWHERE && unit(words.x) < probability) ? a : b;
    if (merged.x <= NOWHERE)
        merged = random_position(x, y, seed, stream, usable_mask, (int2)(first_x, first_y), style_width, style_height);
    out[y * width + x] = merged;
}

/* Style colours at the offsets; the fourth channel is 255 if there is an offset, otherwise 0. */
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

/* Overwrites offsets by the fixed ones, at pixels that have one. */
kernel void apply_fixed(
    global const float2 *fixed_offsets /* height * width */, global float2 *offsets /* height * width */,
    const int width, const int height)
{
    const int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height)
        return;
    if (fixed_offsets[y * width + x].x > NOWHERE)
        offsets[y * width + x] = fixed_offsets[y * width + x];
}

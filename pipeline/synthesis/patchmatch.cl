/* One iteration of parallel PatchMatch on the energy function of benard2013stylizing. The specification is
   reference_energy.py: the same operations in the same order, with integers in all long sums, so that both agree
   bit for bit.

   A work item improves one pixel. It is vectorised over the bytes of the rows of a patch, not across work items:
   neighbouring pixels stop comparing at different rows, and their style patches are at unrelated positions.

   Macros: RADIUS of the patch, CHANNELS per pixel (4, 8, 16 or 32), VECTORS of 16 bytes per row, PAD (margin of the style
   image, px), SCALE_SHIFT, and 0 or 1 for each of ROTATE, COHERENT, TEMPORAL, HISTOGRAM, LINES, MASKED, RIBBONS,
   FIXED, SETTLES. */

#define SIDE (2 * RADIUS + 1)
#define WORDS (CHANNELS / 4)
#define ROW (16 * VECTORS)
#define INFINITE 3.0e38f

/* Data of the pixel that is improved, and of the images around it. */
typedef struct {
    global const uchar *target;          /* top left byte of its patch */
    int target_row;                      /* bytes per row */
    global const uchar *style;           /* padded style, top left byte */
    int style_width, style_height;       /* without padding */
    constant short16 *weights;           /* SIDE * VECTORS: multiplier of each byte */
    global const uchar *style_bins;      /* direction of each style pixel, 0..63, 255 = none */
    global const int *tap_indices;       /* 64 * SIDE * SIDE: pixels from the centre to each tap in the padded style */
    int bin;                             /* direction of this pixel */
    global const short *field;           /* rounded offsets, padded as the target: top left of its patch */
    int field_row;                       /* shorts per row */
    global const short16 *tap_positions; /* 64 (or 1) * SIDE * 2: position of each tap from the centre */
    constant int8 *tap_weights;          /* SIDE * 2: weight of each tap in eq. 5 */
    int coherence_limit;                 /* r_max of eq. 5, px^2 */
    float coherence_weight;              /* w_sc */
    int4 advected_colour;                /* w = 0: no advected colour */
    float temporal_weight;               /* w_tc */
    global const float *penalty;         /* of each style pixel, eq. 8 */
    global const float *style_distance;  /* to the nearest line of the style, px */
    float distance;                      /* to the nearest line of the frame, px */
    float line_limit, line_weight;       /* d_max and w_dt of eq. 9 */
    global const uchar *usable_mask;     /* 0 = the style pixel must not be used */
} Patch;

/* Sum of the lanes, scaled down so that it is exact in float. */
static uint total(const uint8 lanes)
{
    const uint8 part = lanes >> SCALE_SHIFT;
    const uint4 four = part.lo + part.hi;
    const uint2 two = four.lo + four.hi;
    return two.x + two.y;
}

/* Squares of 16 differences, summed in pairs. */
static uint8 squares(const short16 e)
{
    const int16 square = convert_int16(e) * convert_int16(e);
    return as_uint8(square.even + square.odd);
}

#if ROTATE
/* Vector `v`, sixteen bytes, of a row of a rotated patch: 16 / CHANNELS pixels, or half a pixel. */
static uchar16 rotated_row(global const uint *centre, global const int *taps, const int v, const int row_end)
{
    const int tap = v * 16 / CHANNELS;
#if WORDS == 1
    const uint4 found = (uint4)(centre[taps[tap]], centre[taps[min(tap + 1, row_end)]],
                                centre[taps[min(tap + 2, row_end)]], centre[taps[min(tap + 3, row_end)]]);
#elif WORDS == 2
    const uint2 a = vload2(0, centre + 2 * taps[tap]), b = vload2(0, centre + 2 * taps[min(tap + 1, row_end)]);
    const uint4 found = (uint4)(a, b);
#elif WORDS == 4
    const uint4 found = vload4(0, centre + 4 * taps[tap]);
#else
    const uint4 found = vload4(v & 1, centre + 8 * taps[tap]);
#endif
    return as_uchar16(found);
}
#endif

/* Weighted differences of 16 bytes of the patch, vector `v` of row `row` (eq. 3 and 4). */
static short16 difference(const Patch *patch, const int2 at, const int rotation, const int row, const int v)
{
    const int width = patch->style_width + 2 * PAD;
#if ROTATE
    global const uint *centre = (global const uint *)patch->style + ((at.y + PAD) * width + at.x + PAD) * WORDS;
    global const int *taps = patch->tap_indices + rotation * SIDE * SIDE + row * SIDE;
    const short16 style = convert_short16(rotated_row(centre, taps, v, SIDE - 1));
#else
    const short16 style = convert_short16(
        vload16(v, patch->style + ((at.y + PAD + row - RADIUS) * width + at.x + PAD - RADIUS) * CHANNELS));
#endif
    const short16 target = convert_short16(vload16(v, patch->target + row * patch->target_row));
    return (target - style) * patch->weights[row * VECTORS + v];
}

/* Squares of the weighted differences of a row of the patch, summed in lanes. */
static uint8 row_squares(const Patch *patch, const int2 at, const int rotation, const int row)
{
    uint8 sum = squares(difference(patch, at, rotation, row, 0));
#pragma unroll
    for (int v = 1; v < VECTORS; v++)
        sum += squares(difference(patch, at, rotation, row, v));
    return sum;
}

/* Eq. 5: squared distances of the neighbours' offsets from their positions extrapolated from this offset, limited and
   weighted. */
static uint incoherence(const Patch *patch, const int2 at, const int rotation)
{
    const short2 here = convert_short2(at);
    const short16 base = (short16)(here, here, here, here, here, here, here, here);
    uint8 sum = 0;
    for (int row = 0; row < SIDE; row++)
        for (int v = 0; v < 2; v++) {
            const short16 tap = patch->tap_positions[(rotation * SIDE + row) * 2 + v];
            const short16 off = vload16(v, patch->field + row * patch->field_row) - base - tap;
            const short16 near = clamp(off, (short16)(-255), (short16)(255));
            const int8 limited = min(as_int8(squares(near)), (int8)(patch->coherence_limit));
            sum += as_uint8(limited * patch->tap_weights[row * 2 + v]);
        }
    const uint4 four = sum.lo + sum.hi;
    const uint2 two = four.lo + four.hi;
    return two.x + two.y;
}

/* Terms of the centre pixel only: eq. 6 to 9. */
static float centre_cost(const Patch *patch, const int2 at)
{
    float cost = 0.0f;
    const int index = at.y * patch->style_width + at.x;
#if TEMPORAL
    global const uchar *pixel =
        patch->style + ((at.y + PAD) * (patch->style_width + 2 * PAD) + at.x + PAD) * CHANNELS;
    const int3 off = (int3)(pixel[0], pixel[1], pixel[2]) - patch->advected_colour.xyz;
    const float square = (float)(off.x * off.x + off.y * off.y + off.z * off.z);
    cost += patch->advected_colour.w ? patch->temporal_weight * square : 0.0f;
#endif
#if HISTOGRAM
    cost += patch->penalty[index];
#endif
#if LINES
    const float difference = fmin(fabs(patch->distance - patch->style_distance[index]), patch->line_limit);
    cost += patch->line_weight * (difference * difference);
#endif
    return cost;
}

/* Eq. 1 at this pixel for one offset, or a value not below `limit`. */
static float patch_cost(const Patch *patch, const int2 at, const float limit)
{
    float cost = centre_cost(patch, at);
    if (cost >= limit)
        return cost;
    const int rotation = rotation_between(patch->style_bins, at.y * patch->style_width + at.x, patch->bin);
    uint8 lanes = row_squares(patch, at, rotation, RADIUS);
    uint sum = 0;
    for (int distance = 1; distance <= RADIUS; distance++) {
        lanes += row_squares(patch, at, rotation, RADIUS - distance)
                 + row_squares(patch, at, rotation, RADIUS + distance);
        sum = total(lanes);
        const float partial = cost + (float)sum;
        if (partial >= limit)
            return partial;
    }
    cost += (float)sum;
#if COHERENT
    if (cost < limit)
        cost += patch->coherence_weight * (float)incoherence(patch, at, rotation);
#endif
    return cost;
}

/* The best candidate so far: its offset, the rounded offset, its cost; and the candidate that was rejected last. */
typedef struct {
    float2 offset;
    int2 at;
    float cost;
    int2 rejected;
} Best;

static int same(const int2 a, const int2 b) { return a.x == b.x && a.y == b.y; }

/* Replaces the best candidate by `offset` if its cost is lower. */
static void consider(const Patch *patch, Best *best, const float2 offset)
{
    const int2 at = rounded(offset);
    if (at.x < 0 || at.y < 0 || at.x >= patch->style_width || at.y >= patch->style_height)
        return;
    if (same(at, best->at) || same(at, best->rejected))
        return;
#if MASKED
    if (!patch->usable_mask[at.y * patch->style_width + at.x])
        return;
#endif
    const float cost = patch_cost(patch, at, best->cost);
    if (cost < best->cost) {
        best->offset = offset;
        best->at = at;
        best->cost = cost;
    } else
        best->rejected = at;
}

/* Considers the advected offset. If `kept_cost` is below 1, it replaces the best candidate if its cost, multiplied by
   `kept_cost`, is lower, or if both are in the same pixel of the style, so that its fraction continues the motion. */
static void consider_advected(const Patch *patch, Best *best, const float2 offset, const float kept_cost)
{
    if (kept_cost >= 1.0f) {
        consider(patch, best, offset);
        return;
    }
    const int2 at = rounded(offset);
    const int kept = same(at, best->at);
    const float limit = best->cost / kept_cost * 1.000001f; /* above any cost that can be lower; rounding included */
    const float cost = kept_cost * (kept ? best->cost : patch_cost(patch, at, limit));
    if (kept || cost < best->cost) {
        best->offset = offset;
        best->at = at;
        best->cost = cost;
    } else
        best->rejected = at;
}

/* Considers the extrapolated offsets of the four direct neighbours and of the four at distance `jump`, px. */
static void propagate(const Patch *patch, Best *best, global const float2 *offsets, global const uchar *bins,
                      constant float2 *cosines, const int jump, const int x, const int y, const int width,
                      const int height)
{
    for (int k = 0; k < (jump > 1 ? 8 : 4); k++) {
        const int step = k < 4 ? 1 : jump;
        const int dx = (k & 3) == 0 ? -step : (k & 3) == 1 ? step : 0;
        const int dy = (k & 3) == 2 ? -step : (k & 3) == 3 ? step : 0;
        if (x + dx < 0 || x + dx >= width || y + dy < 0 || y + dy >= height)
            continue;
        const int other = (y + dy) * width + x + dx;
        consider(patch, best,
                 extrapolated_offset(offsets[other], (float2)(-dx, -dy), ROTATE ? bins[other] : 255,
                                     patch->style_bins, cosines, patch->style_width, patch->style_height));
    }
}

#if SETTLES
/* Whether the offsets of a pixel and of the pixels that propose candidates to it have not changed since `before`. */
static int settled(global const float2 *offsets, global const float2 *before, const int jump, const int x, const int y,
                   const int width, const int height)
{
    for (int k = 0; k < (jump > 1 ? 9 : 5); k++) {
        const int step = k == 0 ? 0 : k < 5 ? 1 : jump;
        const int dx = (k & 3) == 1 ? -step : (k & 3) == 2 ? step : 0;
        const int dy = (k & 3) == 3 ? -step : (k & 3) == 0 ? step : 0;
        if (x + dx < 0 || x + dx >= width || y + dy < 0 || y + dy >= height)
            continue;
        const int other = (y + dy) * width + x + dx;
        if (offsets[other].x != before[other].x || offsets[other].y != before[other].y)
            return 0;
    }
    return 1;
}
#endif

/* Random search around the best candidate within `radius` px: two draws for each block of random words; each radius is
   half the one before. */
static void search(const Patch *patch, Best *best, float radius, const uint4 counter, const uint2 key)
{
    for (int step = 0; radius >= 1.0f; radius *= 0.25f, step++) {
        const uint4 words = philox(counter + (uint4)(0, 0, 0, step), key);
        for (int k = 0; k < 2; k++) {
            const float2 draw = (float2)(unit(k ? words.z : words.x), unit(k ? words.w : words.y)) * 2.0f - 1.0f;
            const int2 step_px = convert_int2_rte(draw * (k ? radius * 0.5f : radius));
            consider(patch, best, convert_float2(best->at + step_px));
        }
    }
}

/* Scalar parameters of an iteration; `ITERATION` in operations.py has the same layout. */
typedef struct {
    int coherence_limit;                 /* r_max of eq. 5, px^2 */
    float coherence_weight, temporal_weight, kept_cost;
    float line_limit, line_weight;
    int jump;
    float search_px, ribbon_px;
    uint seed, stream, round;
    int top;                             /* first row of a band within the frame */
    int style_width, style_height, width, height;
} Iteration;

/* One iteration: the best offset of each pixel among its own, those of its neighbours in time and space, its ribbons
   and random candidates. */
__attribute__((vec_type_hint(short16))) kernel void
improve(
    const Iteration it, global const float2 *offsets /* height * width */,
    global float2 *improved /* height * width */, global float *costs /* height * width */,
    global const uchar *target /* (height + 2 * RADIUS) * (width + 2 * RADIUS) * CHANNELS + 64 */,
    global const short *field /* 2 * (height + 2 * RADIUS) * (width + 2 * RADIUS) + 32 */,
    global const uchar *bins /* ROTATE * height * width */,
    global const uchar *style /* (style_height + 2 * PAD) * (style_width + 2 * PAD) * CHANNELS + 64 */,
    global const uchar *style_bins /* ROTATE * style_height * style_width */,
    global const uchar *usable_mask /* MASKED * style_height * style_width */,
    global const float *style_distance /* LINES * style_height * style_width */,
    constant short16 *weights /* (2 * RADIUS + 1) * VECTORS */,
    global const int *tap_indices /* 64 * (2 * RADIUS + 1) * (2 * RADIUS + 1) */, constant float2 *cosines /* 64 */,
    global const short16 *tap_positions /* (63 * ROTATE + 1) * (2 * RADIUS + 1) * 2 */,
    constant int8 *tap_weights /* (2 * RADIUS + 1) * 2 */,
    global const uchar4 *advected_colours /* TEMPORAL * height * width */,
    global const float *penalty /* HISTOGRAM * style_height * style_width */,
    global const float *distance /* LINES * height * width */,
    global const float2 *advected /* TEMPORAL * height * width */,
    global const float2 *ribbons /* RIBBONS * 2 * height * width */,
    global const float2 *fixed /* FIXED * height * width */,
    global const float2 *before /* SETTLES * height * width */)
{
    const int x = get_global_id(0), y = get_global_id(1);
    const int width = it.width, height = it.height, style_width = it.style_width, style_height = it.style_height;
    if (x >= width || y >= height)
        return;
    const int here = y * width + x, stride = width + 2 * RADIUS, corner = y * stride + x;
#if FIXED
    if (fixed[here].x > NOWHERE) {
        improved[here] = fixed[here];
        costs[here] = 0.0f;
        return;
    }
#endif
#if SETTLES
    if (settled(offsets, before, it.jump, x, y, width, height)) {
        improved[here] = offsets[here];
        costs[here] = 0.0f;
        return;
    }
#endif
    Patch patch;
    patch.target = target + corner * CHANNELS;
    patch.target_row = stride * CHANNELS;
    patch.style = style;
    patch.style_width = style_width;
    patch.style_height = style_height;
    patch.weights = weights;
    patch.style_bins = style_bins;
    patch.tap_indices = tap_indices;
    patch.bin = ROTATE ? bins[here] : 255;
    patch.field = field + corner * 2;
    patch.field_row = stride * 2;
    patch.tap_positions = tap_positions;
    patch.tap_weights = tap_weights;
    patch.coherence_limit = it.coherence_limit;
    patch.coherence_weight = it.coherence_weight;
    patch.temporal_weight = it.temporal_weight;
    patch.penalty = penalty;
    patch.style_distance = style_distance;
    patch.line_limit = it.line_limit;
    patch.line_weight = it.line_weight;
    patch.usable_mask = usable_mask;
#if TEMPORAL
    patch.advected_colour = convert_int4(advected_colours[here]);
#endif
#if LINES
    patch.distance = distance[here];
#endif
    Best best;
    best.offset = offsets[here];
    best.at = clamped(rounded(best.offset), style_width, style_height);
    best.rejected = (int2)(-1);
    best.cost = patch_cost(&patch, best.at, INFINITE);
#if TEMPORAL
    if (advected[here].x > NOWHERE)
        consider_advected(&patch, &best, advected[here], it.kept_cost);
#endif
    propagate(&patch, &best, offsets, bins, cosines, it.jump, x, y, width, height);
#if RIBBONS
    for (int k = 0; k < 2; k++) {
        const float2 ribbon = ribbons[k * width * height + here];
        if (ribbon.x <= NOWHERE)
            continue;
        const uint4 words = philox((uint4)(x, y + it.top, it.round, 0x41BB0000u + k), (uint2)(it.seed, it.stream));
        const float2 draw = (float2)(unit(words.x), unit(words.y)) * 2.0f - 1.0f;
        consider(&patch, &best, ribbon);
        consider(&patch, &best, ribbon + convert_float2(convert_int2_rte(draw * it.ribbon_px)));
    }
#endif
    search(&patch, &best, it.search_px, (uint4)(x, y + it.top, it.round, 0), (uint2)(it.seed, it.stream));
    improved[here] = best.offset;
    costs[here] = best.cost;
}

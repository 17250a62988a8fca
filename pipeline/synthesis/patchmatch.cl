/* Parallel PatchMatch on the goal function of benard2013stylizing. The specification is reference.py: same operations
   in the same order, and integers wherever sums are long, so that both agree to the last bit.

   A work item improves one pixel. It is vectorised inside, over the bytes of a patch's rows, not across work items:
   neighbouring pixels leave off comparing at different rows, and their style patches lie anywhere.

   Compile-time: RADIUS of the patch, CHANNELS a pixel (4, 8 or 16), VECTORS of 16 a row, PAD of the style,
   SCALE_SHIFT, and 0 or 1 for each of ROTATE, COHERENT, TEMPORAL, HISTOGRAM, LINES, HOLES, KEYED, RIBBONS, FROZEN. */

#define SIDE (2 * RADIUS + 1)
#define WORDS (CHANNELS / 4)
#define ROW (16 * VECTORS)
#define INFINITE 3.0e38f

/* Everything about the pixel being improved and the images around it. */
typedef struct {
    global const uchar *target;      /* its patch's top left byte */
    int target_row;                  /* bytes */
    global const uchar *style;       /* padded style, top left byte */
    int style_width, style_height;   /* without padding */
    constant short16 *weights;       /* SIDE * VECTORS */
    global const uchar *style_bins;  /* direction of each style pixel, 0..63, 255 = none */
    global const int *turns;         /* 64 * SIDE * SIDE: tap -> pixels from the centre in the padded style */
    int bin;                         /* direction of this pixel */
    global const short *field;       /* rounded offsets, padded as the target: patch's top left */
    int field_row;                   /* shorts */
    global const short16 *steps;     /* 64 (or 1) * SIDE * 2: where each tap is expected, from the centre */
    constant int8 *step_weights;     /* SIDE * 2 */
    int reach;                       /* r_max */
    float coherence;
    int4 advected_colour;                   /* advected colour, w = known */
    float steadiness;
    global const float *penalty;     /* of each style pixel, eq. 8 */
    global const float *style_distance;
    float distance, line_limit, line_weight;
    global const uchar *holes;       /* 0 = may not be used */
#if KEYED
    const short16 *expected;         /* SIDE * VECTORS: the target with the change of eq. 10 added */
#endif
} Patch;

static uint total(const uint8 lanes)
{
    const uint8 part = lanes >> SCALE_SHIFT;
    const uint4 four = part.lo + part.hi;
    const uint2 two = four.lo + four.hi;
    return two.x + two.y;
}

static uint8 squares(const short16 e)
{
    const int16 square = convert_int16(e) * convert_int16(e);
    return as_uint8(square.even + square.odd);
}

#if ROTATE
/* Sixteen bytes of a rotated patch's row: 16 / CHANNELS pixels from the tap on. */
static uchar16 turned(global const uint *centre, global const int *taps, const int tap, const int row_end)
{
#if WORDS == 1
    const uint4 found = (uint4)(centre[taps[tap]], centre[taps[min(tap + 1, row_end)]],
                                centre[taps[min(tap + 2, row_end)]], centre[taps[min(tap + 3, row_end)]]);
#elif WORDS == 2
    const uint2 a = vload2(0, centre + 2 * taps[tap]), b = vload2(0, centre + 2 * taps[min(tap + 1, row_end)]);
    const uint4 found = (uint4)(a, b);
#else
    const uint4 found = vload4(0, centre + 4 * taps[tap]);
#endif
    return as_uchar16(found);
}
#endif

static uint8 row_difference(const Patch *patch, const int2 at, const int turn, const int row, uint8 lanes)
{
    const int width = patch->style_width + 2 * PAD;
    global const uchar *mine = patch->target + row * patch->target_row;
#if ROTATE
    global const uint *centre = (global const uint *)patch->style + ((at.y + PAD) * width + at.x + PAD) * WORDS;
    global const int *taps = patch->turns + turn * SIDE * SIDE + row * SIDE;
#else
    global const uchar *theirs =
        patch->style + ((at.y + PAD + row - RADIUS) * width + at.x + PAD - RADIUS) * CHANNELS;
#endif
    for (int v = 0; v < VECTORS; v++) {
#if ROTATE
        const short16 style = convert_short16(turned(centre, taps, v * 16 / CHANNELS, SIDE - 1));
#else
        const short16 style = convert_short16(vload16(v, theirs));
#endif
#if KEYED
        const short16 difference = patch->expected[row * VECTORS + v] - style;
#else
        const short16 difference = convert_short16(vload16(v, mine)) - style;
#endif
        lanes += squares(difference * patch->weights[row * VECTORS + v]);
    }
    return lanes;
}

/* Eq. 5: how far the neighbours are from where this offset would have them. */
static uint incoherence(const Patch *patch, const int2 at, const int turn)
{
    const short2 here = convert_short2(at);
    const short16 base = (short16)(here, here, here, here, here, here, here, here);
    uint8 sum = 0;
    for (int row = 0; row < SIDE; row++)
        for (int v = 0; v < 2; v++) {
            const short16 off = vload16(v, patch->field + row * patch->field_row) - base - patch->steps[(turn * SIDE + row) * 2 + v];
            const short16 near = clamp(off, (short16)(-255), (short16)(255));
            sum += as_uint8(min(as_int8(squares(near)), (int8)(patch->reach)) * patch->step_weights[row * 2 + v]);
        }
    const uint4 four = sum.lo + sum.hi;
    const uint2 two = four.lo + four.hi;
    return two.x + two.y;
}

/* The terms that look at the centre alone: eq. 6 to 9. */
static float centre_cost(const Patch *patch, const int2 at)
{
    float cost = 0.0f;
    const int index = at.y * patch->style_width + at.x;
#if TEMPORAL
    global const uchar *pixel =
        patch->style + ((at.y + PAD) * (patch->style_width + 2 * PAD) + at.x + PAD) * CHANNELS;
    const int3 off = (int3)(pixel[0], pixel[1], pixel[2]) - patch->advected_colour.xyz;
    cost += patch->advected_colour.w ? patch->steadiness * (float)(off.x * off.x + off.y * off.y + off.z * off.z) : 0.0f;
#endif
#if HISTOGRAM
    cost += patch->penalty[index];
#endif
#if LINES
    const float apart = fmin(fabs(patch->distance - patch->style_distance[index]), patch->line_limit);
    cost += patch->line_weight * (apart * apart);
#endif
    return cost;
}

/* Eq. 1 at this pixel for one offset, or something not below `limit`. */
static float patch_cost(const Patch *patch, const int2 at, const float limit)
{
    float cost = centre_cost(patch, at);
    if (cost >= limit)
        return cost;
    const int turn = turn_between(patch->style_bins, at.y * patch->style_width + at.x, patch->bin);
    uint8 lanes = row_difference(patch, at, turn, RADIUS, (uint8)(0));
    for (int out = 1; out <= RADIUS; out++) {
        lanes = row_difference(patch, at, turn, RADIUS - out, lanes);
        lanes = row_difference(patch, at, turn, RADIUS + out, lanes);
        const float so_far = cost + (float)total(lanes);
        if (so_far >= limit)
            return so_far;
    }
    cost += (float)total(lanes);
#if COHERENT
    if (cost < limit)
        cost += patch->coherence * (float)incoherence(patch, at, turn);
#endif
    return cost;
}

typedef struct {
    float2 offset;
    int2 at;
    float cost;
    int2 refused;
} Best;

static int same(const int2 a, const int2 b) { return a.x == b.x && a.y == b.y; }

static void consider(const Patch *patch, Best *best, const float2 offset)
{
    const int2 at = rounded(offset);
    if (at.x < 0 || at.y < 0 || at.x >= patch->style_width || at.y >= patch->style_height)
        return;
    if (same(at, best->at) || same(at, best->refused))
        return;
#if HOLES
    if (!patch->holes[at.y * patch->style_width + at.x])
        return;
#endif
    const float cost = patch_cost(patch, at, best->cost);
    if (cost < best->cost) {
        best->offset = offset;
        best->at = at;
        best->cost = cost;
    } else
        best->refused = at;
}

#if KEYED
/* The patch that the style is compared with where eq. 10 holds: the target, moved by `share` / 128 of the difference
   between the style at the advected offset and the neighbouring frame. Two squares with a common variable are one
   square plus a constant, so that eq. 3, 4 and 10 together cost as much as eq. 3 and 4. */
static void expect(const Patch *patch, const float2 advected, global const uchar *neighbour,
                   global const uchar *visible, constant short16 *share, short16 *expected)
{
    const int2 at = clamped(rounded(advected), patch->style_width, patch->style_height);
    const int width = patch->style_width + 2 * PAD, known = advected.x > NOWHERE;
    const int turn = turn_between(patch->style_bins, at.y * patch->style_width + at.x, patch->bin);
    for (int row = 0; row < SIDE; row++) {
        global const uchar *now = patch->target + row * patch->target_row;
        global const uchar *then = neighbour + row * patch->target_row;
        global const uchar *seen = visible + row * patch->target_row;
#if ROTATE
        global const uint *centre =
            (global const uint *)patch->style + ((at.y + PAD) * width + at.x + PAD) * WORDS;
        global const int *taps = patch->turns + turn * SIDE * SIDE + row * SIDE;
#else
        global const uchar *theirs =
            patch->style + ((at.y + PAD + row - RADIUS) * width + at.x + PAD - RADIUS) * CHANNELS;
#endif
        for (int v = 0; v < VECTORS; v++) {
            const short16 target = convert_short16(vload16(v, now));
#if ROTATE
            const short16 style = convert_short16(turned(centre, taps, v * 16 / CHANNELS, SIDE - 1));
#else
            const short16 style = convert_short16(vload16(v, theirs));
#endif
            const short16 mask = convert_short16(as_char16(vload16(v, seen)));
            const short16 change = (style - convert_short16(vload16(v, then))) & mask;
            expected[row * VECTORS + v] = known ? target + ((change * share[v] + (short16)(64)) >> 7) : target;
        }
    }
}
#endif

static void propagate(const Patch *patch, Best *best, global const float2 *offsets, global const uchar *bins,
                      constant float2 *cosines, const int jump, const int x, const int y, const int width,
                      const int height)
{
    for (int k = 0; k < (jump > 1 ? 8 : 4); k++) {
        const int far = k < 4 ? 1 : jump;
        const int dx = (k & 3) == 0 ? -far : (k & 3) == 1 ? far : 0;
        const int dy = (k & 3) == 2 ? -far : (k & 3) == 3 ? far : 0;
        if (x + dx < 0 || x + dx >= width || y + dy < 0 || y + dy >= height)
            continue;
        const int other = (y + dy) * width + x + dx;
        consider(patch, best,
                 extrapolated_offset(offsets[other], (float2)(-dx, -dy), ROTATE ? bins[other] : 255, patch->style_bins, cosines,
                         patch->style_width, patch->style_height));
    }
}

/* Around the best so far, `far` px and less: two draws for each number of Philox, each span half the last. */
static void search(const Patch *patch, Best *best, float far, const uint4 counter, const uint2 key)
{
    for (int step = 0; far >= 1.0f; far *= 0.25f, step++) {
        const uint4 words = philox(counter + (uint4)(0, 0, 0, step), key);
        for (int k = 0; k < 2; k++) {
            const float2 draw = (float2)(unit(k ? words.z : words.x), unit(k ? words.w : words.y)) * 2.0f - 1.0f;
            const int2 step_px = convert_int2_rte(draw * (k ? far * 0.5f : far));
            consider(patch, best, convert_float2(best->at + step_px));
        }
    }
}

/* The numbers of an iteration; energy.py has the same layout as a structured dtype. */
typedef struct {
    int reach;                       /* r_max of eq. 5, px^2 */
    float coherence, steadiness;
    float line_limit, line_weight;
    int jump;
    float search_px, ribbon_px;
    uint seed, stream, round;
    int top;                         /* row of the frame that is the first one here */
    int style_width, style_height, width, height;
} Iteration;

__attribute__((vec_type_hint(short16))) kernel void
improve(
    const Iteration it, global const float2 *offsets /* height * width */,
    global float2 *improved /* height * width */, global float *costs /* height * width */,
    global const uchar *target /* (height + 2 * RADIUS) * (width + 2 * RADIUS) * CHANNELS + 64 */,
    global const short *field /* 2 * (height + 2 * RADIUS) * (width + 2 * RADIUS) + 32 */,
    global const uchar *bins /* ROTATE * height * width */,
    global const uchar *style /* (style_height + 2 * PAD) * (style_width + 2 * PAD) * CHANNELS + 64 */,
    global const uchar *style_bins /* ROTATE * style_height * style_width */,
    global const uchar *holes /* HOLES * style_height * style_width */,
    global const float *style_distance /* LINES * style_height * style_width */,
    constant short16 *weights /* (2 * RADIUS + 1) * VECTORS */,
    global const int *turns /* 64 * (2 * RADIUS + 1) * (2 * RADIUS + 1) */, constant float2 *cosines /* 64 */,
    global const short16 *steps /* (63 * ROTATE + 1) * (2 * RADIUS + 1) * 2 */,
    constant int8 *step_weights /* (2 * RADIUS + 1) * 2 */,
    global const uchar4 *advected_colours /* TEMPORAL * height * width */,
    global const float *penalty /* HISTOGRAM * style_height * style_width */,
    global const float *distance /* LINES * height * width */,
    global const float2 *advected /* (TEMPORAL or KEYED) * height * width */,
    global const uchar *neighbour /* KEYED * ((height + 2 * RADIUS) * (width + 2 * RADIUS) * CHANNELS + 64) */,
    global const uchar *visible /* KEYED * ((height + 2 * RADIUS) * (width + 2 * RADIUS) * CHANNELS + 64) */,
    constant short16 *share /* VECTORS */, global const float2 *ribbons /* RIBBONS * 2 * height * width */,
    global const float2 *fixed /* FROZEN * height * width */)
{
    const int x = get_global_id(0), y = get_global_id(1);
    const int width = it.width, height = it.height, style_width = it.style_width, style_height = it.style_height;
    if (x >= width || y >= height)
        return;
    const int here = y * width + x, stride = width + 2 * RADIUS, corner = y * stride + x;
#if FROZEN
    if (fixed[here].x > NOWHERE) {
        improved[here] = fixed[here];
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
    patch.turns = turns;
    patch.bin = ROTATE ? bins[here] : 255;
    patch.field = field + corner * 2;
    patch.field_row = stride * 2;
    patch.steps = steps;
    patch.step_weights = step_weights;
    patch.reach = it.reach;
    patch.coherence = it.coherence;
    patch.steadiness = it.steadiness;
    patch.penalty = penalty;
    patch.style_distance = style_distance;
    patch.line_limit = it.line_limit;
    patch.line_weight = it.line_weight;
    patch.holes = holes;
#if TEMPORAL
    patch.advected_colour = convert_int4(advected_colours[here]);
#endif
#if LINES
    patch.distance = distance[here];
#endif
#if KEYED
    short16 expected[SIDE * VECTORS];
    expect(&patch, advected[here], neighbour + corner * CHANNELS, visible + corner * CHANNELS, share, expected);
    patch.expected = expected;
#endif
    Best best;
    best.offset = offsets[here];
    best.at = clamped(rounded(best.offset), style_width, style_height);
    best.refused = (int2)(-1);
    best.cost = patch_cost(&patch, best.at, INFINITE);
#if TEMPORAL
    if (advected[here].x > NOWHERE)
        consider(&patch, &best, advected[here]);
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

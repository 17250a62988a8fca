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
    int4 before;                     /* advected colour, w = known */
    float steadiness;
    global const float *penalty;     /* of each style pixel, eq. 8 */
    global const float *style_distance;
    float distance, line_limit, line_weight;
    global const uchar *holes;       /* 0 = may not be used */
#if KEYED
    const short16 *wanted;           /* SIDE * VECTORS: what the derivative terms expect of the style */
    const short16 *wanted_weights;
#endif
} Spot;

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

static uint8 row_difference(const Spot *spot, const int2 at, const int turn, const int row, uint8 lanes)
{
    const int width = spot->style_width + 2 * PAD;
    global const uchar *mine = spot->target + row * spot->target_row;
#if ROTATE
    global const uint *centre = (global const uint *)spot->style + ((at.y + PAD) * width + at.x + PAD) * WORDS;
    global const int *taps = spot->turns + turn * SIDE * SIDE + row * SIDE;
#else
    global const uchar *theirs =
        spot->style + ((at.y + PAD + row - RADIUS) * width + at.x + PAD - RADIUS) * CHANNELS;
#endif
    for (int v = 0; v < VECTORS; v++) {
#if ROTATE
        const short16 style = convert_short16(turned(centre, taps, v * 16 / CHANNELS, SIDE - 1));
#else
        const short16 style = convert_short16(vload16(v, theirs));
#endif
        const short16 difference = convert_short16(vload16(v, mine)) - style;
        lanes += squares(difference * spot->weights[row * VECTORS + v]);
#if KEYED
        lanes += squares((spot->wanted[row * VECTORS + v] - style) * spot->wanted_weights[row * VECTORS + v]);
#endif
    }
    return lanes;
}

/* Eq. 5: how far the neighbours are from where this offset would have them. */
static uint incoherence(const Spot *spot, const int2 at, const int turn)
{
    const short2 here = convert_short2(at);
    const short16 base = (short16)(here, here, here, here, here, here, here, here);
    uint8 sum = 0;
    for (int row = 0; row < SIDE; row++)
        for (int v = 0; v < 2; v++) {
            const short16 off = vload16(v, spot->field + row * spot->field_row) - base - spot->steps[(turn * SIDE + row) * 2 + v];
            const short16 near = clamp(off, (short16)(-255), (short16)(255));
            sum += as_uint8(min(as_int8(squares(near)), (int8)(spot->reach)) * spot->step_weights[row * 2 + v]);
        }
    const uint4 four = sum.lo + sum.hi;
    const uint2 two = four.lo + four.hi;
    return two.x + two.y;
}

/* The terms that look at the centre alone: eq. 6 to 9. */
static float centre_cost(const Spot *spot, const int2 at)
{
    float cost = 0.0f;
    const int index = at.y * spot->style_width + at.x;
#if TEMPORAL
    global const uchar *pixel =
        spot->style + ((at.y + PAD) * (spot->style_width + 2 * PAD) + at.x + PAD) * CHANNELS;
    const int3 off = (int3)(pixel[0], pixel[1], pixel[2]) - spot->before.xyz;
    cost += spot->before.w ? spot->steadiness * (float)(off.x * off.x + off.y * off.y + off.z * off.z) : 0.0f;
#endif
#if HISTOGRAM
    cost += spot->penalty[index];
#endif
#if LINES
    const float apart = fmin(fabs(spot->distance - spot->style_distance[index]), spot->line_limit);
    cost += spot->line_weight * (apart * apart);
#endif
    return cost;
}

/* Eq. 1 at this pixel for one offset, or something not below `limit`. */
static float goal(const Spot *spot, const int2 at, const float limit)
{
    float cost = centre_cost(spot, at);
    if (cost >= limit)
        return cost;
    const int turn = turn_between(spot->style_bins, at.y * spot->style_width + at.x, spot->bin);
    uint8 lanes = row_difference(spot, at, turn, RADIUS, (uint8)(0));
    for (int out = 1; out <= RADIUS; out++) {
        lanes = row_difference(spot, at, turn, RADIUS - out, lanes);
        lanes = row_difference(spot, at, turn, RADIUS + out, lanes);
        const float so_far = cost + (float)total(lanes);
        if (so_far >= limit)
            return so_far;
    }
    cost += (float)total(lanes);
#if COHERENT
    if (cost < limit)
        cost += spot->coherence * (float)incoherence(spot, at, turn);
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

static void consider(const Spot *spot, Best *best, const float2 offset)
{
    const int2 at = rounded(offset);
    if (at.x < 0 || at.y < 0 || at.x >= spot->style_width || at.y >= spot->style_height)
        return;
    if (same(at, best->at) || same(at, best->refused))
        return;
#if HOLES
    if (!spot->holes[at.y * spot->style_width + at.x])
        return;
#endif
    const float cost = goal(spot, at, best->cost);
    if (cost < best->cost) {
        best->offset = offset;
        best->at = at;
        best->cost = cost;
    } else
        best->refused = at;
}

#if KEYED
/* What eq. 10 expects of the style at each tap: what it was where the pixel came from, and the change since. */
static void expect(const Spot *spot, const float2 was, global const uchar *past, global const uchar *visible,
                   const int row_px, constant short *weights, short *wanted, short *wanted_weights)
{
    const int2 at = within(rounded(was), spot->style_width, spot->style_height);
    const int width = spot->style_width + 2 * PAD;
    const int turn = turn_between(spot->style_bins, at.y * spot->style_width + at.x, spot->bin);
    global const uchar *centre = spot->style + ((at.y + PAD) * width + at.x + PAD) * CHANNELS;
    for (int i = 0; i < SIDE * ROW; i++)
        wanted[i] = wanted_weights[i] = 0;
    for (int row = 0; row < SIDE; row++)
        for (int tap = 0; tap < SIDE; tap++) {
            if (was.x <= NOWHERE || !visible[row * row_px + tap])
                continue;
            global const uchar *then = centre + spot->turns[(turn * SIDE + row) * SIDE + tap] * CHANNELS;
            for (int c = 0; c < CHANNELS; c++) {
                const int i = row * ROW + tap * CHANNELS + c, j = (row * row_px + tap) * CHANNELS + c;
                wanted[i] = (short)((int)then[c] + (int)spot->target[j] - (int)past[j]);
                wanted_weights[i] = weights[i];
            }
        }
}
#endif

static void propagate(const Spot *spot, Best *best, global const float2 *offsets, global const uchar *bins,
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
        consider(spot, best,
                 carried(offsets[other], (float2)(-dx, -dy), ROTATE ? bins[other] : 255, spot->style_bins, cosines,
                         spot->style_width, spot->style_height));
    }
}

/* Around the best so far, `far` px and less: two draws for each number of Philox, each span half the last. */
static void search(const Spot *spot, Best *best, float far, const uint4 counter, const uint2 key)
{
    for (int step = 0; far >= 1.0f; far *= 0.25f, step++) {
        const uint4 words = philox(counter + (uint4)(0, 0, 0, step), key);
        for (int k = 0; k < 2; k++) {
            const float2 draw = (float2)(unit(k ? words.z : words.x), unit(k ? words.w : words.y)) * 2.0f - 1.0f;
            const int2 step_px = convert_int2_rte(draw * (k ? far * 0.5f : far));
            consider(spot, best, convert_float2(best->at + step_px));
        }
    }
}

__attribute__((vec_type_hint(short16))) kernel void
improve(global const float2 *offsets, global float2 *improved, global float *costs, global const uchar *target,
        global const short *field, global const uchar *bins, global const uchar *style,
        global const uchar *style_bins, global const uchar *holes, global const float *style_distance,
        constant short16 *weights, global const int *turns, constant float2 *cosines, global const short16 *steps,
        constant int8 *step_weights, global const uchar4 *before, global const float *penalty,
        global const float *distance, global const float2 *was, global const uchar *past,
        global const uchar *visible, constant short *keyed_weights, global const float2 *ribbons,
        global const float2 *given, const int reach, const float coherence, const float steadiness,
        const float line_limit, const float line_weight, const int jump, const float search_px,
        const float ribbon_px, const uint seed, const uint stream, const uint round_, const int top,
        const int style_width, const int style_height, const int width, const int height)
{
    const int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height)
        return;
    const int here = y * width + x, stride = width + 2 * RADIUS, corner = y * stride + x;
#if FROZEN
    if (given[here].x > NOWHERE) {
        improved[here] = given[here];
        costs[here] = 0.0f;
        return;
    }
#endif
    Spot spot;
    spot.target = target + corner * CHANNELS;
    spot.target_row = stride * CHANNELS;
    spot.style = style;
    spot.style_width = style_width;
    spot.style_height = style_height;
    spot.weights = weights;
    spot.style_bins = style_bins;
    spot.turns = turns;
    spot.bin = ROTATE ? bins[here] : 255;
    spot.field = field + corner * 2;
    spot.field_row = stride * 2;
    spot.steps = steps;
    spot.step_weights = step_weights;
    spot.reach = reach;
    spot.coherence = coherence;
    spot.steadiness = steadiness;
    spot.penalty = penalty;
    spot.style_distance = style_distance;
    spot.line_limit = line_limit;
    spot.line_weight = line_weight;
    spot.holes = holes;
#if TEMPORAL
    spot.before = convert_int4(before[here]);
#endif
#if LINES
    spot.distance = distance[here];
#endif
#if KEYED
    short16 wanted[SIDE * VECTORS], wanted_weights[SIDE * VECTORS];
    expect(&spot, was[here], past + corner * CHANNELS, visible + corner, stride, keyed_weights, (short *)wanted,
           (short *)wanted_weights);
    spot.wanted = wanted;
    spot.wanted_weights = wanted_weights;
#endif
    Best best;
    best.offset = offsets[here];
    best.at = within(rounded(best.offset), style_width, style_height);
    best.refused = (int2)(-1);
    best.cost = goal(&spot, best.at, INFINITE);
#if TEMPORAL
    if (was[here].x > NOWHERE)
        consider(&spot, &best, was[here]);
#endif
    propagate(&spot, &best, offsets, bins, cosines, jump, x, y, width, height);
#if RIBBONS
    for (int k = 0; k < 2; k++) {
        const float2 ribbon = ribbons[k * width * height + here];
        if (ribbon.x <= NOWHERE)
            continue;
        const uint4 words = philox((uint4)(x, y + top, round_, 0x41BB0000u + k), (uint2)(seed, stream));
        const float2 draw = (float2)(unit(words.x), unit(words.y)) * 2.0f - 1.0f;
        consider(&spot, &best, ribbon);
        consider(&spot, &best, ribbon + convert_float2(convert_int2_rte(draw * ribbon_px)));
    }
#endif
    search(&spot, &best, search_px, (uint4)(x, y + top, round_, 0), (uint2)(seed, stream));
    improved[here] = best.offset;
    costs[here] = best.cost;
}

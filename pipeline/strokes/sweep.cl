/* Implicit strokes: kagaya2011video, section 4.2. The specification is the compiled Python in sweep.py; same operations,
 * same order, so that both round alike.
 *
 * Every pixel walks the streamline through it, both ways, and takes the stroke of the lowest rank that it meets. `first`
 * holds ranks of discs, `order` the stroke of each rank. A canvas is h rows of w pixels of seven floats.
 */

#define OPEN INT_MAX
#define LONGEST 1.15f

/* Unit vectors along (cos 2a, sin 2a), of the two angles the one that half-angle formulas give first. */
kernel void ways(global const float *field, global float *way, const int width, const int height)
{
    const int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height)
        return;
    const int here = y * width + x;
    const float u = field[2 * here], v = field[2 * here + 1];
    const float length = sqrt(u * u + v * v);
    float tx = 0.0f, ty = 0.0f;
    if (length > 1e-6f) {
        const float scale = 0.5f / length;
        const float large = sqrt((length + fabs(u)) * scale);
        const float small = v * scale / large;
        tx = u >= 0.0f ? large : small;
        ty = u >= 0.0f ? small : large;
    }
    way[2 * here] = tx;
    way[2 * here + 1] = ty;
}

static float apart2(global const uchar *guide, global const float *aims, const int here, const int k)
{
    const float r = (float)guide[3 * here] - aims[3 * k];
    const float g = (float)guide[3 * here + 1] - aims[3 * k + 1];
    const float b = (float)guide[3 * here + 2] - aims[3 * k + 2];
    return r * r + g * g + b * b;
}

/* One stroke a row: radius, opacity, relief, grain. */
typedef struct {
    global const float *colours, *aims, *traits, *hairs;
    global const int *offset;
} Strokes;

/* Lay stroke k over the pixel, which is s along and t px across it. */
static void lay(global float *pixel, const Strokes strokes, const int k, const float s, float t, const float streaks)
{
    const float r = strokes.traits[4 * k], g = strokes.traits[4 * k + 3];
    const float a = strokes.traits[4 * k + 1] * min(max(r + 0.5f - fabs(t), 0.0f), 1.0f);
    t = min(max(t / r, -1.0f), 1.0f);
    float shade = 0.0f, ridge = 1.0f - t * t * t * t;
    if (g > 0.0f) {
        const int row = (int)(2048.0f + t * r * 2.0f) + (strokes.offset[k] & 63);
        const int column = (int)(8192.0f + s * 1.5f) + (strokes.offset[k] >> 6);
        const float trace = strokes.hairs[(row & 63) * 256 + (column & 255)];
        shade = g * streaks * (trace - 0.5f);
        ridge *= 1.0f - g * (1.0f - trace);
    }
    for (int c = 0; c < 3; c++) {
        pixel[c] += a * (strokes.colours[3 * k + c] + shade - pixel[c]);
        pixel[4 + c] += a * (strokes.aims[3 * k + c] - pixel[4 + c]);
    }
    pixel[3] += a * (strokes.traits[4 * k + 2] * ridge - pixel[3]);
}

kernel void sweep(global const int *first, global const float *way, global const float *lengths,
                  global const float *away, global const float *points, global const float *colours,
                  global const float *aims, global const float *traits, global const int *order,
                  global const int *offset, global const float *hairs, global const uchar *guide, const int guided,
                  const float limit, const float streaks, const float step, global float *canvas, global int *out,
                  const int width, const int height)
{
    const int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height)
        return;
    const int here = y * width + x;
    if (away[here] > lengths[here] * 0.5f * LONGEST + 1.0f)
        return;
    int best = OPEN, second = OPEN;
    float t = 0.0f, s = 0.0f, nearby = 0.0f, second_t = 0.0f, second_s = 0.0f;
    const int steps = (int)(lengths[here] * 0.5f / step);
    const float start_x = way[2 * here], start_y = way[2 * here + 1];
    const bool still = start_x == 0.0f && start_y == 0.0f;
    for (int side = 0; side < 2; side++) {
        const float sign = (float)(1 - 2 * side);
        float px = (float)x, py = (float)y, dx = start_x * sign, dy = start_y * sign;
        float step_x = step * dx, step_y = step * dy;
        for (int i = side; i < (still ? 1 : steps + 1); i++) {
            if (i) {
                px += step_x;
                py += step_y;
            }
            /* Adding before the cut keeps it a floor: one pixel outside is -1, not 0. */
            const int ix = (int)(px + 1.5f) - 1, iy = (int)(py + 1.5f) - 1;
            if (ix < 0 || iy < 0 || ix >= width || iy >= height)
                break;
            const int there = iy * width + ix;
            if (away[there] > (float)(steps - i) * step * LONGEST + 1.0f)
                break;
            const int rank = first[there];
            if (rank <= second && rank < OPEN) {
                const int k = order[rank];
                bool allowed = true;
                if (guided && rank != best && rank != second)
                    allowed = apart2(guide, aims, here, k) <= limit * limit;
                if (allowed) {
                    const float ox = px - points[2 * k], oy = py - points[2 * k + 1];
                    float aside = (oy * dx - ox * dy) * sign;
                    if (steps == 0 || still)
                        aside = sqrt(ox * ox + oy * oy);
                    const float ahead = ox * dx + oy * dy;
                    if (fabs(aside) < traits[4 * k] + 0.5f) {
                        const float along = sign * (ahead - step * (float)i);
                        if (rank < best) {
                            second = best, second_t = t, second_s = s;
                            best = rank, t = aside, s = along, nearby = fabs(ahead);
                        } else if (rank == best) {
                            /* Of its places on the way, the one beside its seed tells best where in it this is. */
                            if (fabs(ahead) < nearby)
                                t = aside, s = along, nearby = fabs(ahead);
                        } else if (rank < second) {
                            second = rank, second_t = aside, second_s = along;
                        }
                    }
                }
            }
            float nx = way[2 * there], ny = way[2 * there + 1];
            const float dot = nx * dx + ny * dy;
            if (dot == 0.0f)
                nx = dx, ny = dy;
            else if (dot < 0.0f)
                nx = -nx, ny = -ny;
            step_x = step * nx;
            step_y = step * ny;
            if (fabs(dot) > 0.8f) {
                /* Adams-Bashforth's second order: as many look-ups as Euler's, and circles stay circles. */
                step_x += 0.5f * step * (nx - dx);
                step_y += 0.5f * step * (ny - dy);
            }
            dx = nx;
            dy = ny;
        }
    }
    if (best == OPEN)
        return;
    const Strokes strokes = {colours, aims, traits, hairs, offset};
    const int k = order[best];
    global float *pixel = canvas + 7 * here;
    out[here] = k;
    /* At a stroke's very edge the next one shows, so that edges between strokes are smooth as well. */
    if (second < OPEN && traits[4 * k] + 0.5f - fabs(t) < 1.0f)
        lay(pixel, strokes, order[second], second_s, second_t, streaks);
    lay(pixel, strokes, k, s, t, streaks);
}

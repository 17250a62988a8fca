/* Flow-based difference of Gaussians: kang2007coherent, section 2.2. The specification is the NumPy code in
 * fdog.py, with the same operations in the same order.
 *
 * A plane is h rows of w floats, a tangent field h rows of w pairs (x, y). Only sums, products and one division are
 * used, so that both implementations round alike.
 */

#define GUARD                                                                                                          \
    const int x = get_global_id(0), y = get_global_id(1);                                                              \
    if (x >= width || y >= height)                                                                                     \
        return

/* Sample bilinearly at a position inside the picture. */
static float sample(global const float *plane, const float px, const float py, const int width, const int height)
{
    const int x0 = (int)px, y0 = (int)py;
    const int x1 = min(x0 + 1, width - 1), y1 = min(y0 + 1, height - 1);
    const float fx = px - (float)x0, fy = py - (float)y0;
    const float a = plane[y0 * width + x0], b = plane[y0 * width + x1];
    const float c = plane[y1 * width + x0], d = plane[y1 * width + x1];
    const float top = a + fx * (b - a);
    const float low = c + fx * (d - c);
    return top + fy * (low - top);
}

/* Weighted sum of samples along the normal, one px apart; weights[k] applies to distance k on either side. */
kernel void across(
    global const float *gray /* height * width */, global const float *tangent /* 2 * height * width */,
    constant float *weights /* radius + 1 */, global float *out /* height * width */, const int radius,
    const int width, const int height)
{
    GUARD;
    const float2 t = vload2(y * width + x, tangent);
    const float right = (float)(width - 1), bottom = (float)(height - 1);
    float sum = weights[0] * gray[y * width + x];
    for (int k = 1; k <= radius; k++) {
        const float dx = (float)k * -t.y, dy = (float)k * t.x;
        const float ax = clamp((float)x + dx, 0.0f, right), ay = clamp((float)y + dy, 0.0f, bottom);
        const float bx = clamp((float)x - dx, 0.0f, right), by = clamp((float)y - dy, 0.0f, bottom);
        sum += weights[k] * (sample(gray, ax, ay, width, height) + sample(gray, bx, by, width, height));
    }
    out[y * width + x] = sum;
}

/* Weighted mean of the response along the streamline through each pixel, in both directions up to its ends. Each step
 * of one px uses the tangent half a step ahead. A streamline that has ended continues with weight 0: leaving the loop
 * would prevent vectorisation and take twice the time.
 */
kernel void along(
    global const float *response /* height * width */, global const float *tangent /* 2 * height * width */,
    constant float *weights /* steps + 1 */, global float *out /* height * width */, const int steps,
    const int width, const int height)
{
    GUARD;
    const float right = (float)(width - 1), bottom = (float)(height - 1);
    const int here = y * width + x;
    float sum = weights[0] * response[here], total = weights[0];
    for (int side = 0; side < 2; side++) {
        float step_x = side ? -tangent[2 * here] : tangent[2 * here];
        float step_y = side ? -tangent[2 * here + 1] : tangent[2 * here + 1];
        float px = (float)x, py = (float)y, alive = 1.0f;
        for (int k = 1; k <= steps; k++) {
            const int mx = (int)(clamp(px + 0.5f * step_x, 0.0f, right) + 0.5f);
            const int my = (int)(clamp(py + 0.5f * step_y, 0.0f, bottom) + 0.5f);
            const float tx = tangent[2 * (my * width + mx)], ty = tangent[2 * (my * width + mx) + 1];
            const float cosine = tx * step_x + ty * step_y;
            step_x = cosine < 0.0f ? -tx : tx;
            step_y = cosine < 0.0f ? -ty : ty;
            px += step_x;
            py += step_y;
            const float sx = clamp(px, 0.0f, right), sy = clamp(py, 0.0f, bottom);
            alive = cosine == 0.0f || sx != px || sy != py ? 0.0f : alive;
            const float weight = weights[k] * alive;
            sum += weight * sample(response, sx, sy, width, height);
            total += weight;
        }
    }
    out[here] = sum / total;
}

/* Draw the lines into the picture. */
kernel void superimpose(
    global const float *gray /* height * width */, global const float *response /* height * width */,
    global float *out /* height * width */, const int width, const int height)
{
    GUARD;
    const int at = y * width + x;
    out[at] = gray[at] - max(response[at], 0.0f);
}

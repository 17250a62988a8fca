/* TV-L1 optical flow, zach2007duality. The specification is tvl1_reference.py: same operations in the same order.

   An image or field is one buffer of float planes, each height rows of width. x runs along dimension 0, y along 1,
   the plane along 2. Border pixels are replicated outside the picture.

   Neighbours along x are read conditionally instead of at a clamped index: CPU compilers then load a whole vector
   instead of gathering its elements. */

#define AT(plane, x, y) ((plane) * height * width + (y) * width + (x))
#define GUARD                                                                                                          \
    const int x = get_global_id(0), y = get_global_id(1);                                                              \
    if (x >= width || y >= height)                                                                                     \
        return

/* Divergence of the vector field in planes k, k + 1: backward differences, zero outside. */
static float divergence(global const float *p, const int k, const int x, const int y, const int width, const int height)
{
    const float left = x > 0 ? p[AT(k, x - 1, y)] : 0.0f;
    const float up = y > 0 ? p[AT(k + 1, x, y - 1)] : 0.0f;
    return (p[AT(k, x, y)] - left) + (p[AT(k + 1, x, y)] - up);
}

static float denoised(global const float *image, global const float *p, const float theta, const int n, const int x,
                      const int y, const int width, const int height)
{
    return image[AT(n, x, y)] + theta * divergence(p, 2 * n, x, y, width, height);
}

/* One dual step of ROF denoising; planes of p: x and y of image 0, of image 1. */
kernel void rof(
    global const float *image /* Z * height * width */, global const float *p /* 2 * Z * height * width */,
    global float *p_next /* 2 * Z * height * width */, const float theta, const float ratio, const int width,
    const int height)
{
    const int n = get_global_id(2);
    GUARD;
    const float here = denoised(image, p, theta, n, x, y, width, height);
    const float dx = x < width - 1 ? denoised(image, p, theta, n, x + 1, y, width, height) - here : 0.0f;
    const float dy = y < height - 1 ? denoised(image, p, theta, n, x, y + 1, width, height) - here : 0.0f;
    const float px = p[AT(2 * n, x, y)] + ratio * dx;
    const float py = p[AT(2 * n + 1, x, y)] + ratio * dy;
    const float norm = max(1.0f, sqrt(px * px + py * py));
    p_next[AT(2 * n, x, y)] = px / norm;
    p_next[AT(2 * n + 1, x, y)] = py / norm;
}

/* Texture part: the image minus a share of the denoised image. */
kernel void texture(
    global const float *image /* Z * height * width */, global const float *p /* 2 * Z * height * width */,
    global float *out /* Z * height * width */, const float theta, const float share, const int width,
    const int height)
{
    const int n = get_global_id(2);
    GUARD;
    const float value = image[AT(n, x, y)];
    out[AT(n, x, y)] = value - share * denoised(image, p, theta, n, x, y, width, height);
}

/* Halve the size: binomial filter 1 4 6 4 1 along x, then along y, at the even pixels. */
kernel void down(
    global const float *in /* Z * in_height * in_width */, global float *out /* Z * height * width */,
    const int in_width, const int in_height, const int width, const int height)
{
    const int n = get_global_id(2);
    GUARD;
    const float weight[5] = {0.0625f, 0.25f, 0.375f, 0.25f, 0.0625f};
    float sum = 0.0f;
    for (int dy = -2; dy <= 2; dy++) {
        global const float *row = in + (n * in_height + clamp(2 * y + dy, 0, in_height - 1)) * in_width;
        float across = 0.0f;
        for (int dx = -2; dx <= 2; dx++)
            across += weight[dx + 2] * row[clamp(2 * x + dx, 0, in_width - 1)];
        sum += weight[dy + 2] * across;
    }
    out[AT(n, x, y)] = sum;
}

/* Double the size bilinearly, and the displacements. */
kernel void up(
    global const float *in /* Z * in_height * in_width */, global float *out /* Z * height * width */,
    const int in_width, const int in_height, const int width, const int height)
{
    const int n = get_global_id(2);
    GUARD;
    const int x0 = x / 2, x1 = min((x + 1) / 2, in_width - 1);
    const int y0 = y / 2, y1 = min((y + 1) / 2, in_height - 1);
    global const float *plane = in + n * in_height * in_width;
    const float above = plane[y0 * in_width + x0] + plane[y0 * in_width + x1];
    const float under = plane[y1 * in_width + x0] + plane[y1 * in_width + x1];
    out[AT(n, x, y)] = 0.5f * (above + under);
}

/* Central differences of fourth order; planes out: x and y of image 0, of image 1. */
kernel void gradient(
    global const float *image /* Z * height * width */, global float *out /* 2 * Z * height * width */,
    const int width, const int height)
{
    const int n = get_global_id(2);
    GUARD;
    const int l2 = max(x - 2, 0), l1 = max(x - 1, 0), r1 = min(x + 1, width - 1), r2 = min(x + 2, width - 1);
    const int u2 = max(y - 2, 0), u1 = max(y - 1, 0), d1 = min(y + 1, height - 1), d2 = min(y + 2, height - 1);
    const float near_x = image[AT(n, r1, y)] - image[AT(n, l1, y)];
    const float far_x = image[AT(n, r2, y)] - image[AT(n, l2, y)];
    const float near_y = image[AT(n, x, d1)] - image[AT(n, x, u1)];
    const float far_y = image[AT(n, x, d2)] - image[AT(n, x, u2)];
    out[AT(2 * n, x, y)] = (8.0f * near_x - far_x) / 12.0f;
    out[AT(2 * n + 1, x, y)] = (8.0f * near_y - far_y) / 12.0f;
}

/* Weights of cubic convolution (Catmull-Rom) at a fraction t between the middle two of four samples. */
static float4 cubic(const float t)
{
    const float a = t * (-0.5f + t * (1.0f - 0.5f * t));
    const float b = 1.0f + t * t * (1.5f * t - 2.5f);
    const float c = t * (0.5f + t * (2.0f - 1.5f * t));
    const float d = t * t * (0.5f * t - 0.5f);
    return (float4)(a, b, c, d);
}

static float sample(global const float *plane, const int4 column, const int4 row, const float4 wx, const float4 wy)
{
    const float a = wx.x * plane[row.x + column.x] + wx.y * plane[row.x + column.y] + wx.z * plane[row.x + column.z]
        + wx.w * plane[row.x + column.w];
    const float b = wx.x * plane[row.y + column.x] + wx.y * plane[row.y + column.y] + wx.z * plane[row.y + column.z]
        + wx.w * plane[row.y + column.w];
    const float c = wx.x * plane[row.z + column.x] + wx.y * plane[row.z + column.y] + wx.z * plane[row.z + column.z]
        + wx.w * plane[row.z + column.w];
    const float d = wx.x * plane[row.w + column.x] + wx.y * plane[row.w + column.y] + wx.z * plane[row.w + column.z]
        + wx.w * plane[row.w + column.w];
    return wy.x * a + wy.y * b + wy.z * c + wy.w * d;
}

/* The data term linearised about the flow: planes of out are its gradient (x, y) and its constant part. */
kernel void linearise(
    global const float *image /* 2 * height * width */, global const float *slope /* 4 * height * width */,
    global const float *flow /* 2 * height * width */, global float *out /* 3 * height * width */,
    const int width, const int height)
{
    GUARD;
    const float u = flow[AT(0, x, y)], v = flow[AT(1, x, y)];
    const float sx = (float)x + u, sy = (float)y + v;
    const float inside = sx >= 0.0f && sx <= (float)(width - 1) && sy >= 0.0f && sy <= (float)(height - 1);
    const float cx = clamp(sx, 0.0f, (float)(width - 1)), cy = clamp(sy, 0.0f, (float)(height - 1));
    const int4 step = (int4)(-1, 0, 1, 2);
    const int4 column = clamp((int4)((int)floor(cx)) + step, 0, width - 1);
    const int4 row = clamp((int4)((int)floor(cy)) + step, 0, height - 1) * width;
    const float4 wx = cubic(cx - floor(cx)), wy = cubic(cy - floor(cy));
    const float value = sample(image + AT(1, 0, 0), column, row, wx, wy);
    const float dx = sample(slope + AT(2, 0, 0), column, row, wx, wy);
    const float dy = sample(slope + AT(3, 0, 0), column, row, wx, wy);
    const float gx = 0.5f * (slope[AT(0, x, y)] + dx) * inside;
    const float gy = 0.5f * (slope[AT(1, x, y)] + dy) * inside;
    out[AT(0, x, y)] = gx;
    out[AT(1, x, y)] = gy;
    out[AT(2, x, y)] = (value - image[AT(0, x, y)]) * inside - gx * u - gy * v;
}

/* Primal step: thresholding (zach2007duality, eq. 15), then the divergence of the dual field. */
kernel void primal(
    global const float *data /* 3 * height * width */, global const float *p /* 4 * height * width */,
    global float *flow /* 2 * height * width */, const float bound, const float theta, const int width,
    const int height)
{
    GUARD;
    const float gx = data[AT(0, x, y)], gy = data[AT(1, x, y)];
    const float u = flow[AT(0, x, y)], v = flow[AT(1, x, y)];
    const float rho = data[AT(2, x, y)] + gx * u + gy * v;
    const float step = clamp(-rho / max(gx * gx + gy * gy, 1e-9f), -bound, bound);
    flow[AT(0, x, y)] = u + step * gx + theta * divergence(p, 0, x, y, width, height);
    flow[AT(1, x, y)] = v + step * gy + theta * divergence(p, 2, x, y, width, height);
}

/* Dual step on both components of the flow. */
kernel void dual(
    global const float *flow /* 2 * height * width */, global float *p /* 4 * height * width */,
    const float ratio, const int width, const int height)
{
    GUARD;
    const int below = min(y + 1, height - 1);
    for (int n = 0; n < 2; n++) {
        const float here = flow[AT(n, x, y)];
        const float dx = x < width - 1 ? flow[AT(n, x + 1, y)] - here : 0.0f;
        const float dy = flow[AT(n, x, below)] - here;
        const float norm = 1.0f + ratio * sqrt(dx * dx + dy * dy);
        p[AT(2 * n, x, y)] = (p[AT(2 * n, x, y)] + ratio * dx) / norm;
        p[AT(2 * n + 1, x, y)] = (p[AT(2 * n + 1, x, y)] + ratio * dy) / norm;
    }
}

/* Exact median of 5 x 5 by elimination: the smallest and the largest of any 14 of the 25 values are not the median. */
#define ORDER(a, b)                                                                                                    \
    {                                                                                                                  \
        const float low = min(a, b);                                                                                  \
        b = max(a, b);                                                                                                \
        a = low;                                                                                                       \
    }

kernel void median(
    global const float *in /* Z * height * width */, global float *out /* Z * height * width */,
    const int width, const int height)
{
    const int n = get_global_id(2);
    GUARD;
    float v[25];
#pragma unroll
    for (int k = 0; k < 5; k++) {
        global const float *row = in + AT(n, 0, clamp(y + k - 2, 0, height - 1));
        const float first = row[0], last = row[width - 1];
        v[5 * k] = x >= 2 ? row[x - 2] : first;
        v[5 * k + 1] = x >= 1 ? row[x - 1] : first;
        v[5 * k + 2] = row[x];
        v[5 * k + 3] = x < width - 1 ? row[x + 1] : last;
        v[5 * k + 4] = x < width - 2 ? row[x + 2] : last;
    }
#pragma unroll
    for (int count = 14, first = 0; count >= 3; count--, first++) {
#pragma unroll
        for (int k = 1; k < count; k++)
            ORDER(v[first], v[first + k]);
#pragma unroll
        for (int k = 1; k < count - 1; k++)
            ORDER(v[first + k], v[first + count - 1]);
        if (count > 3)
            v[first + count - 1] = v[28 - count];
    }
    out[AT(n, x, y)] = v[12];
}

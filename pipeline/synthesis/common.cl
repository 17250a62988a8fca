/* Functions that the kernels of synthesis share. The text is prepended to each file, because OpenCL drivers resolve
   include paths differently.

   An offset is a float2: a position in the style image, px, with the centre of its first pixel at (0, 0). An x of at
   most NOWHERE means that there is no offset. Directions are 64 steps of 180 degrees; 255 = no direction. */

#define NOWHERE -1.0e6f

/* Philox 4x32-10 of salmon2011parallel: four random words of a counter and a key. */
static uint4 philox(uint4 c, uint2 k)
{
    for (int i = 0; i < 10; i++) {
        const uint high_x = mul_hi(0xD2511F53u, c.x), low_x = 0xD2511F53u * c.x;
        const uint high_z = mul_hi(0xCD9E8D57u, c.z), low_z = 0xCD9E8D57u * c.z;
        c = (uint4)(high_z ^ c.y ^ k.x, low_z, high_x ^ c.w ^ k.y, low_x);
        k += (uint2)(0x9E3779B9u, 0xBB67AE85u);
    }
    return c;
}

/* Converts a random word to [0, 1), 24 bits. */
static float unit(const uint word) { return (float)(word >> 8) * 5.9604645e-8f; }

static int2 rounded(const float2 offset) { return convert_int2(rint(offset)); }

static int2 clamped(const int2 at, const int width, const int height)
{
    return clamp(at, (int2)(0), (int2)(width - 1, height - 1));
}

/* Index of the rotation, 0..63, from the direction `bin` of a pixel to the direction of the style's pixel `index`. */
static int rotation_between(global const uchar *style_bins, const int index, const int bin)
{
#if ROTATE
    const int style_bin = style_bins[index];
    return style_bin == 255 || bin == 255 ? 0 : (style_bin - bin) & 63;
#else
    return 0;
#endif
}

/* Extrapolates an offset to the pixel at distance `step`, px: C_t(p, step) of benard2013stylizing. */
static float2 extrapolated_offset(const float2 offset, const float2 step, const int bin,
                                  global const uchar *style_bins, constant float2 *cosines, const int style_width,
                                  const int style_height)
{
#if ROTATE
    const int2 at = clamped(rounded(offset), style_width, style_height);
    const float2 c = cosines[rotation_between(style_bins, at.y * style_width + at.x, bin)];
    return offset + (float2)(c.x * step.x - c.y * step.y, c.y * step.x + c.x * step.y);
#else
    return offset + step;
#endif
}

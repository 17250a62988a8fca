/* Exact Euclidean distance transform: the nearest pixel of a set for each pixel. The specification is distance.py. */

/* Row of the nearest pixel of the set in the same column, the upper one of two; -1 = the column has none. */
kernel void columns(
    global const uchar *set /* height * width */, global int *rows /* height * width */, const int width,
    const int height)
{
    const int x = get_global_id(0);
    if (x >= width)
        return;
    int last = -1;
    for (int y = 0; y < height; y++) {
        if (set[y * width + x])
            last = y;
        rows[y * width + x] = last;
    }
    last = -1;
    for (int y = height - 1; y >= 0; y--) {
        if (set[y * width + x])
            last = y;
        const int above = rows[y * width + x];
        if (last >= 0 && (above < 0 || last - y < y - above))
            rows[y * width + x] = last;
    }
}

/* Position (x, y) of the nearest pixel of the set at a squared distance below `most`, px^2; (-1, -1) = there is none.
   Columns are searched outward, the left one first. */
kernel void nearest(
    global const int *rows /* height * width */, global int2 *out /* height * width */, const int most,
    const int width, const int height)
{
    const int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height)
        return;
    int best = most;
    int2 found = (int2)(-1);
    for (int far = 0; far < width && far * far < best; far++)
        for (int side = 0; side < (far ? 2 : 1); side++) {
            const int column = side ? x + far : x - far;
            if (column < 0 || column >= width)
                continue;
            const int row = rows[y * width + column];
            const int square = row < 0 ? INT_MAX : far * far + (row - y) * (row - y);
            if (square < best) {
                best = square;
                found = (int2)(column, row);
            }
        }
    out[y * width + x] = found;
}

/* Test kernel: arithmetic, a work-group barrier and a bounds check. */
kernel void probe(global const float *in, global float *out, const int count)
{
    local float shared[8];
    const int i = get_global_id(0), k = get_local_id(0);
    shared[k] = i < count ? in[i] : 0.0f;
    barrier(CLK_LOCAL_MEM_FENCE);
    if (i < count)
        out[i] = 3.0f * shared[k] + shared[7 - k] + sqrt(in[i]);
}

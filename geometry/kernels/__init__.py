"""Infrastructure of compiled kernels: SIMD vectors, atomics, device functions, the kernel cache, threads.

geometry/kernels/README.md says why each exists and what it gains.
"""

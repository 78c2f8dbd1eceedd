"""Infrastructure of compiled kernels: SIMD vectors, atomics, device functions, the kernel cache, threads.

docs/explanation/compiled_kernels.md says why each exists and what it gains.
"""

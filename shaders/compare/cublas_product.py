#!/usr/bin/env python3
"""A plain product of dense f32 planes with vectors by PyTorch (cuBLAS), to hold `earthshine bench gpu` against.

    python3 shaders/compare/cublas_product.py --m 8192
    earthshine bench gpu --product-m 8192 --json

Prints one JSON object. Three planes of M x M times a vector each, as a frame's product; a device-to-device copy of a plane
beside it, times from CUDA events, the quickest of some rounds. Our planes are lower triangles (half the bytes), so compare
`product_ms` with that of `bench gpu`, and each `gb_s` with the copy of its own run.
"""

import argparse
import json
import sys


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--m", type=int, default=8192, help="rows and columns of a plane")
    parser.add_argument("--rounds", type=int, default=20, help="of which the quickest counts")
    arguments = parser.parse_args()
    try:
        import torch
    except ImportError:
        print("PyTorch is not installed: pip install torch", file=sys.stderr)
        return 1
    if not torch.cuda.is_available():
        print("PyTorch sees no CUDA device", file=sys.stderr)
        return 1
    # Tensor cores round products to 10 bits.
    torch.backends.cuda.matmul.allow_tf32 = False
    device, m = torch.device("cuda"), arguments.m
    planes = [torch.rand(m, m, device=device) for _ in range(3)]
    vectors = [torch.rand(m, device=device) for _ in range(3)]
    results = [torch.empty(m, device=device) for _ in range(3)]
    copy = torch.empty_like(planes[0])

    def product() -> None:
        for plane, vector, result in zip(planes, vectors, results):
            torch.mv(plane, vector, out=result)

    def quickest_ms(run) -> float:
        best = float("inf")
        for _ in range(arguments.rounds + 1):
            begin, end = (torch.cuda.Event(enable_timing=True) for _ in range(2))
            begin.record()
            run()
            end.record()
            torch.cuda.synchronize()
            best = min(best, begin.elapsed_time(end))
        return best

    product_ms = quickest_ms(product)
    copy_ms = quickest_ms(lambda: copy.copy_(planes[0]))
    plane_bytes = 4 * m * m
    figures = {
        "adapter": torch.cuda.get_device_name(device),
        "m": m,
        "product_ms": product_ms,
        "product_gb_s": 3 * plane_bytes / 1e6 / product_ms,
        "copy_gb_s": 2 * plane_bytes / 1e6 / copy_ms,
    }
    print(json.dumps(figures))
    return 0


if __name__ == "__main__":
    sys.exit(main())

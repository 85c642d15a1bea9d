"""Mean HDR-FLIP of two OpenEXR pictures (Andersson et al. 2021), 67 pixels per degree."""

import sys

import flip_evaluator
import numpy as np
import OpenEXR


def read(path):
    channels = OpenEXR.File(path, separate_channels=True).channels()
    return np.ascontiguousarray(np.stack([channels[c].pixels for c in "RGB"], axis=-1), np.float32)


def main():
    reference, test = map(read, sys.argv[1:3])
    _, mean, _ = flip_evaluator.evaluate(reference, test, "HDR", inputsRGB=False)
    print(f"{mean:.4f}")


if __name__ == "__main__":
    main()

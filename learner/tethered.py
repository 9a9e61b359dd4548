"""The former name of `common.tethered`, which running supervisors still start their actors by."""

from __future__ import annotations

import sys

from common.tethered import main

if __name__ == "__main__":
    main(sys.argv[1:])

"""Sets up TORCS: ``python -m dpsearch.envs.torcs``."""

import subprocess
import sys
from pathlib import Path

sys.exit(subprocess.call(["bash", str(Path(__file__).with_name("build.sh")), *sys.argv[1:]]))

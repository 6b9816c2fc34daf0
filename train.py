"""Train a policy: ``python train.py algo=rpg env=tmaze``."""

from dpsearch.train import main

if __name__ == "__main__":
    main()

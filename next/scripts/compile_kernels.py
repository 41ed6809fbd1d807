"""Compiles all kernels once, so that processes that start together find them on disk."""

import fitball

if __name__ == "__main__":
    fitball.model()

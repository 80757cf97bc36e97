"""One module a family of contenders; each says how it solves the problem and binds itself to given arrays."""

from contenders.base import Contender, UnavailableError

__all__ = ["Contender", "UnavailableError"]

"""What several threads gain over one."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence


def gain(works: Sequence[Callable[[], object]], rounds: int) -> float:
    """How many times the work of one thread is done in the same time by a thread for each; best of rounds."""

    def seconds(workers: Sequence[Callable[[], object]]) -> float:
        running = [threading.Thread(target=worker) for worker in workers]
        begun = time.perf_counter()
        for thread in running:
            thread.start()
        for thread in running:
            thread.join()
        return time.perf_counter() - begun

    alone, together = (min(seconds(w) for _ in range(rounds)) for w in (works[:1], works))
    return len(works) * alone / together

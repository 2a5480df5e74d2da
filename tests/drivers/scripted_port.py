"""A port that follows a script: these bytes must come, those are the answer, and nothing else happens."""


class ScriptedPort:
    """Stands in for an open serial port; ``dialogue`` is pairs of (bytes expected, bytes answered)."""

    def __init__(self, dialogue: list[tuple[bytes, bytes]]) -> None:
        self._script = list(dialogue)
        self._received = bytearray()
        self._answers = bytearray()

    @property
    def in_waiting(self) -> int:
        return len(self._answers)

    def read(self, size: int = 1, /) -> bytes:
        data = bytes(self._answers[:size])
        del self._answers[:size]
        return data

    def write(self, data: bytes, /) -> int:
        self._received += data
        while self._script and self._received.startswith(self._script[0][0]):
            expected, answer = self._script.pop(0)
            del self._received[: len(expected)]
            self._answers += answer
        upcoming = self._script[0][0] if self._script else b""
        assert upcoming.startswith(self._received), (
            f"{bytes(self._received)!r} came; {upcoming!r} was expected"
        )
        return len(data)

    def close(self) -> None:
        assert not self._script, f"never asked for: {self._script}"


def dialogue(text: str, end: bytes = b"\r\n") -> list[tuple[bytes, bytes]]:
    """The script of a dialogue in lines: ``> sent``, and below it ``< answered``, if anything."""
    script: list[tuple[bytes, bytes]] = []
    for line in filter(None, (line.strip() for line in text.splitlines())):
        mark, _, said = line.partition(" ")
        if mark == ">":
            script.append((said.encode() + end, b""))
        else:
            script[-1] = (script[-1][0], script[-1][1] + said.encode() + b"\r\n")
    return script

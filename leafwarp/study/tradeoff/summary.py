"""What the table says, in a few sentences."""

from __future__ import annotations

from collections.abc import Sequence

from leafwarp.study.tradeoff.table import Row

# Errors of the shape that a person may want, as shares of the length; of the water, where shapes cannot be compared.
WANTED = (0.05, 0.01, 0.002)
# A speed-up counts where it adds less than this to the error.
LITTLE = {"shape": 0.005, "water": 0.02}


def percent(share: float) -> str:
    """A share as a person reads it."""
    return f"{100.0 * share:.2g} %"


def summarise(rows: Sequence[Row], kind: str, singles: Sequence[Row], floor: float) -> list[str]:
    """Sentences for a user who has to choose.

    Args:
        rows: All rows.
        kind: The error to go by: "shape" or "water".
        singles: Those that depart from the scene as written in one choice.
        floor: The reference's own error, below which settings cannot be told apart.
    """

    def error(row: Row) -> float | None:
        found = getattr(row, f"{kind}_error")
        return None if found is None else max(found, floor)

    def said(row: Row) -> str:
        found = getattr(row, f"{kind}_error")
        return percent(found) if found > floor else f"below the reference's own {percent(floor)}"

    measured = [row for row in rows if row.measured and error(row) is not None]
    own = next((row for row in measured if row.name == "scene"), None)
    sentences = []
    what = {"shape": "of the leaf's length", "water": "of the water"}[kind]
    if own is not None:
        sentences.append(
            f"As written the film takes {own.seconds:.3g} s, {own.seconds_per_second:.3g} s a second of playback; its "
            f"error is {said(own)} {what}."
        )
        changes = [row for row in singles if row.measured and error(row) is not None]
        better = min(changes, key=lambda row: (error(row), row.seconds), default=own)
        if error(better) < 0.8 * error(own):
            sentences.append(
                f"What costs the most error: with {better.varied} it is {said(better)}, in "
                f"{better.seconds / own.seconds:.2g} times the time."
            )
        else:
            sentences.append("No single choice would make the error much smaller.")
        faster = [row for row in changes if error(row) <= error(own) + LITTLE[kind]]
        fastest = min(faster, key=lambda row: row.seconds, default=own)
        if fastest.seconds < 0.9 * own.seconds:
            sentences.append(
                f"What buys the most speed: with {fastest.varied} it takes {fastest.seconds / own.seconds:.2g} times "
                f"the time; its error is {said(fastest)}."
            )
        else:
            sentences.append("No single choice would make it much faster at about the same error.")
    for wanted in WANTED:
        enough = [row for row in measured if error(row) <= wanted]
        if enough:
            row = min(enough, key=lambda row: row.seconds)
            sentences.append(
                f"The fastest with an error of {percent(wanted)} at most: {row.varied} ({row.seconds:.3g} s, "
                f"{said(row)})."
            )
    return sentences

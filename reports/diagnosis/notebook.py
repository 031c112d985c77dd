"""A diagnosis and a replayed run in a notebook: in short, as a fragment, as a table and drawn."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from reports.common.effect_names import get_effect_label, replace_effect_ids
from reports.common.notebook import (
    NOT_DRAWN,
    ResultView,
    ShownTable,
    build_view,
    encode_figure,
    encode_picture,
    render_fragment,
)
from reports.common.palette import STATE_COLOURS, TRACTOR_COLOURS
from reports.common.rendering import make_json_safe
from reports.diagnosis.log_checks import (
    describe_columns,
    describe_hints,
    describe_holdout,
    describe_unlike_runs,
    describe_unsaved_finds,
)
from reports.diagnosis.page import render_diagnosis_page
from reports.diagnosis.replay import (
    describe_replay,
    draw_replay,
    draw_replayed_path,
    format_replay_json,
    list_error_rows_by_horizon,
    render_replay_page,
)
from reports.diagnosis.sentences import describe_log_size, sort_findings
from reports.diagnosis.tables import build_diagnosis_dict, build_effect_table, format_diagnosis_json, list_found
from reports.plan.map_figure import render_png
from vehicle.identification.diagnosis.results import Diagnosis, ReplayResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame

ERROR_COLOURS = {"before": TRACTOR_COLOURS[1], "after": STATE_COLOURS["working"], "noise": "#CFCFC6"}


@build_view.register
def build_diagnosis_view(diagnosis: Diagnosis) -> ResultView:
    """A diagnosis: verdict, errors before and after, and the effects."""
    return ResultView(
        summary=lambda: _summarize(diagnosis),
        html=lambda: render_diagnosis_fragment(diagnosis),
        table=lambda: build_effects_frame(diagnosis),
        draw=(lambda axes: draw_errors(axes, diagnosis)) if diagnosis.before else None,
        not_drawn=f"{NOT_DRAWN}: the logs are too short for errors.",
        files={
            ".json": lambda: format_diagnosis_json(diagnosis),
            ".html": lambda: render_diagnosis_page(diagnosis),
        },
    )


def _summarize(diagnosis: Diagnosis) -> str:
    """The verdict, and what runs that were held out on request say of it."""
    is_requested = diagnosis.holdout is not None and diagnosis.holdout.is_requested
    return " ".join(
        [replace_effect_ids(diagnosis.headline), *(describe_holdout(diagnosis)[1:] if is_requested else [])]
    )


def render_diagnosis_fragment(diagnosis: Diagnosis) -> str:
    """Verdict, how much was read, and the effects that were found, or all of them where none was."""
    findings = sort_findings(diagnosis.findings)
    shown = list_found(findings) or findings
    left_out = len(findings) - len(shown)
    note = f"{left_out} more effects were examined; to_pandas() has all." if left_out else ""
    tables = [build_effect_table(shown, ("Id in files",)).convert_for_notebook(note=note)]
    picture = None
    if diagnosis.before:
        picture = encode_picture(lambda axes: draw_errors(axes, diagnosis), (6.0, 3.0))
    sentences = [
        *describe_columns(diagnosis),
        *describe_hints(diagnosis),
        *describe_unlike_runs(diagnosis),
        f"{describe_log_size(diagnosis)}.",
        *describe_holdout(diagnosis),
        *filter(None, [describe_unsaved_finds(diagnosis)]),
    ]
    return render_fragment(
        replace_effect_ids(diagnosis.headline), sentences, tables, picture, "Error across the path before and after"
    )


def build_effects_frame(diagnosis: Diagnosis) -> DataFrame:
    """A row per effect, as in the JSON.

    `value`, `value_low` and `value_high` are of the first of its values, in `unit`; `values` holds all of them.
    """
    import pandas as pd

    entries = make_json_safe(build_diagnosis_dict(diagnosis)["effects"])
    return pd.DataFrame([_flatten_effect(entry) for entry in entries])


def _flatten_effect(entry: dict[str, Any]) -> dict[str, Any]:
    """An effect of the JSON with a key for each end of its intervals."""
    values, intervals = entry["value"] or {}, entry["interval"] or {}
    first = next(iter(values), None)
    low, high = intervals.get(first) or (None, None)
    gain_low, gain_high = entry["gain_interval"] or (None, None)
    return {
        "id": entry["id"],
        "effect": get_effect_label(entry["id"]),
        "status": entry["status"],
        "calibrated": entry["calibrated"],
        "value": values.get(first),
        "value_low": low,
        "value_high": high,
        "unit": entry["unit"],
        "gain_pct": entry["gain_pct"],
        "gain_low_pct": gain_low,
        "gain_high_pct": gain_high,
        "smallest_visible": entry["smallest_visible"],
        "block": entry["block"],
        "equivalent_to": ", ".join(entry["equivalent_to"]),
        "exchange": entry["exchange"],
        "law": None if entry["law"] is None else entry["law"]["kind"],
        "values": entry["value"],
    }


def draw_errors(axes: Axes, diagnosis: Diagnosis) -> None:
    """Error across the path over the length of the pieces: before, after, and the noise."""
    errors = {"before": diagnosis.before, "noise": diagnosis.noise_floor, "after": diagnosis.after}
    for name, by_horizon in errors.items():
        across = [error.cross_cm for error in by_horizon.values()]
        width = 6.0 if name == "noise" else 1.5  # what is left is often as small as the noise, and lies on it
        axes.plot(list(by_horizon), across, marker="o", color=ERROR_COLOURS[name], linewidth=width, label=name)
    axes.set_ylim(bottom=0.0)
    axes.set(xlabel="length of the pieces, s", ylabel="error across, cm")
    axes.legend(frameon=False, fontsize=8)


def build_replay_view(replayed: ReplayResult, remarks: Sequence[str]) -> ResultView:
    """A replayed run with the remarks on its log: errors by length of the pieces, and the two paths."""
    return ResultView(
        summary=lambda: f"{replayed.name} against {replayed.tractor}. {describe_replay(replayed)}",
        html=lambda: _render_replay_fragment(replayed, remarks),
        table=lambda: build_errors_frame(replayed),
        draw=lambda axes: draw_replayed_path(axes, replayed),
        files={
            ".json": lambda: format_replay_json(replayed, remarks),
            ".html": lambda: render_replay_page(replayed, remarks),
            ".png": lambda: render_png(draw_replay(replayed)),
        },
    )


def _render_replay_fragment(replayed: ReplayResult, remarks: Sequence[str]) -> str:
    table = ShownTable(("Over", "Across, cm", "Along, cm", "Heading, deg"), list_error_rows_by_horizon(replayed))
    title = f"{replayed.name} against {replayed.tractor}"
    picture = encode_figure(draw_replay(replayed))
    return render_fragment(
        title, [describe_replay(replayed), *remarks], [table], picture, "Measured and simulated path, angle and speed"
    )


def build_errors_frame(replayed: ReplayResult) -> DataFrame:
    """A row per length of the pieces: `horizon_s`, `cross_cm`, `along_cm`, `heading_deg`."""
    import pandas as pd

    rows = [{"horizon_s": horizon, **make_json_safe(vars(error))} for horizon, error in replayed.errors.items()]
    return pd.DataFrame(rows, columns=["horizon_s", "cross_cm", "along_cm", "heading_deg"], dtype="float64")

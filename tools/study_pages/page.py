"""Studies as a page: every word and figure from study.json, and from what was noted of the machine."""

GOALS_DB = [40, 50, 60]
INTRODUCTION = """# Studies

Error against run time, scene by scene: written by `tools/studies`, which measures all of it again;
nothing here is typed by hand. [STUDY.md](../STUDY.md) explains every figure.

In each table stands, integrator by integrator, the least that it costs to come within 40, 50 and 60 dB
of the truth, and whatever is on the Pareto front of all settings: nearer to the truth than all that cost
no more. Errors are on linear rgb over all pixels. Early stop is 0 and the filter `exact` unless said.
"""


def page(studies, flags):
    """The page of (name, study.json, what was noted of the machine) of each scene."""
    lines = [INTRODUCTION, *machine(studies, flags), *summary(studies)]
    for name, study, noted in studies:
        lines += [f"## {name}", "", *head(name, study, noted), *settings(study), *orders(study)]
        lines += [*levels(study), *streaming(study)]
    return "\n".join(lines).rstrip() + "\n"


def machine(studies, flags):
    """With what all was measured."""
    first, noted = studies[0][1], [noted for _, _, noted in studies if noted]
    lines = [f"- device: {first['device']} ({first['driver']})"]
    if noted:
        minutes = sum(one["seconds"] for one in noted) / 60
        load = max(one["load"] for one in noted)
        days = sorted({one["day"] for one in noted})
        versions = ", ".join(sorted({one["version"] for one in noted}))
        lines += [
            f"- machine: {noted[0]['cpu']}, {noted[0]['cores']} cores; {versions}, {' to '.join(days[:: len(days) - 1 or 1])}",
            f"- took: {minutes:.0f} minutes; processes that ran beside it, at most: {load:.1f}",
        ]
    return [*lines, f"- `ashfall study SCENE {flags}`", ""]


def summary(studies):
    """Times of every integrator side by side."""
    names = list(dict.fromkeys(one for _, study, _ in studies for one in integrators(study)))
    columns = [f"{name}, {goal} dB" for name in names for goal in GOALS_DB]
    body = []
    for scene, study, _ in studies:
        found = [cheapest(study, name, goal) for name in names for goal in GOALS_DB]
        body.append([f"[{scene}](#{scene})", *(ms(row) if row else "-" for row in found)])
    return ["ms of the cheapest setting of each:", "", *table(["scene", *columns], body), ""]


def head(name, study, noted):
    """What was drawn, and its charts."""
    across, down = study["size"]
    took = f"; {noted['seconds']:.0f} s for all of it" if noted else ""
    lines = [
        f"`{study['scene']}`, view \"{study['view']}\", {across} x {down}; ms: {study['clock']} time of a "
        f"picture, medians of {study['repeats']}{took}.",
        "",
        f"![{name}: error against run time]({name}.svg)",
        "",
    ]
    if study["streaming"]:
        lines += [f"![{name}: error while streaming]({name}-streaming.svg)", ""]
    return lines


def settings(study):
    """The front, and what each integrator needs."""
    named = {row["key"]: [] for row in study["settings"] if row["pareto"]}
    for integrator in integrators(study):
        for goal in GOALS_DB:
            row = cheapest(study, integrator, goal)
            if row is not None:
                named.setdefault(row["key"], []).append(f"{goal} dB")
    rows = [row for row in study["settings"] if row["key"] in named]
    order = integrators(study)
    rows.sort(key=lambda row: (order.index(row["setting"]["integrator"]), row["measured"]["ms"]["median"]))
    body = []
    for row in rows:
        measured = row["measured"]
        error = measured["error"]
        body.append(
            [
                row["setting"]["integrator"],
                words(row["setting"]),
                ms(row),
                f"{measured['samples'] * 1e-6:.2f}",
                scientific(error["whole"]["rmse"]),
                digits(error["whole"]["psnr_db"], 1),
                digits(error["ssim"], 5),
                digits(error["flip"], 4),
                ", ".join([*(["front"] if row["pareto"] else []), *named[row["key"]]]),
            ]
        )
    columns = ["integrator", "setting", "ms", "M samples", "RMSE", "PSNR, dB", "SSIM", "FLIP", "front, cheapest for"]
    return [*table(columns, body, words_at=(0, 1, 8)), ""]


def orders(study):
    """How fast errors fall."""
    body = []
    for row in study["orders"]:
        seen = row["observed"]
        over = f"{number(seen['over'][0])} to {number(seen['over'][1])}" if seen else "-"
        order = f"{seen['order']:.2f}" if seen else "-"
        body.append([row["integrator"], row["parameter"], order, over, str(seen["points"]) if seen else "-"])
    columns = ["integrator", "error falls with", "to the power of", "over", "points"]
    return [*table(columns, body, words_at=(0, 1)), ""] if body else []


def levels(study):
    """Errors of levels drawn alone."""
    parts = ["level_of_detail", "integration", "total"]
    body = [
        [str(row["level"]), *(error_of(row[part]) for part in parts)]
        for row in study["levels"]
    ]
    columns = ["level", "RMSE of the level itself", "of its integration", "of its picture"]
    return [*table(columns, body), ""] if body else []


def streaming(study):
    """From the first picture to the finished one."""
    found = study["streaming"]
    if not found or not found["rounds"]:
        return []
    last = "converged" if found["converged"] else "last, not converged"
    body = [
        [
            name,
            str(one["round"]),
            digits(one["ms"], 0),
            str(one["bricks_uploaded"]),
            scientific(one["error"]["whole"]["rmse"]),
            digits(one["error"]["whole"]["psnr_db"], 1),
        ]
        for name, one in (("first", found["rounds"][0]), (last, found["rounds"][-1]))
    ]
    columns = ["picture while streaming", "round", "ms on the wall", "bricks", "RMSE", "PSNR, dB"]
    return [*table(columns, body), ""]


def integrators(study):
    """In the order of the study."""
    return list(dict.fromkeys(row["setting"]["integrator"] for row in study["settings"]))


def cheapest(study, integrator, goal):
    """The setting of least time that is so near to the truth; None where none is."""

    def reaches(row):
        measured = row["measured"]
        if row["setting"]["integrator"] != integrator or not measured or measured["incomplete"]:
            return False
        whole = measured["error"]["whole"]
        # Of equal pictures the PSNR has no finite value.
        return whole["rmse"] == 0 or (whole["psnr_db"] is not None and whole["psnr_db"] >= goal)

    near = [row for row in study["settings"] if reaches(row)]
    return min(near, key=lambda row: row["measured"]["ms"]["median"], default=None)


def words(setting):
    """A setting, without its integrator and what is as usual."""
    tolerance = setting["tolerance"]
    said = [f"step {number(setting['step'])}" if tolerance is None else f"tolerance {number(tolerance)}"]
    if setting["early_stop"] != 0 and tolerance is not None:
        # What the scene says counts as yes or no alone.
        said.append("early stop at a quarter of it")
    elif setting["early_stop"] != 0:
        said.append(f"early stop {number(setting['early_stop'])}")
    if setting["filter"] != "exact":
        said.append(f"filter {setting['filter']}")
    least, most = setting["level_min"], setting["level_max"]
    if (least, most) != (0, 0):
        said.append(f"level {least}" if least == most else f"levels {least} to {'any' if most is None else most}")
    if setting["paged"]:
        said.append(f"paged in {setting['atlas_mib']} MiB")
    return ", ".join(said)


def error_of(figures):
    """RMSE and PSNR; a level against itself has no error."""
    if figures is None:
        return "-"
    rmse, psnr_db = figures["whole"]["rmse"], figures["whole"]["psnr_db"]
    if rmse == 0:
        return "0"
    return f"{scientific(rmse)} ({digits(psnr_db, 1)} dB)"


def ms(row):
    median = row["measured"]["ms"]["median"]
    return digits(median, 0 if median >= 100 else 1)


def number(value):
    """As it was asked for: 0.0001, not 1e-4."""
    return f"{value:.7f}".rstrip("0").rstrip(".")


def digits(value, count):
    return "-" if value is None else f"{value:.{count}f}"


def scientific(value):
    return "-" if value is None else f"{value:.1e}".replace("e-0", "e-")


def table(columns, body, words_at=(0,)):
    """Lines of a Markdown table; other columns than `words_at` are numbers."""
    rules = ["---" if at in words_at else "---:" for at in range(len(columns))]
    return ["| " + " | ".join(cells) + " |" for cells in [columns, rules, *body]]

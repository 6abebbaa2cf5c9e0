"""Friction laws chosen from the data: `friction = "auto"` on three real robots."""

from typing import Any

from proofs.robots.scores import identified, mix_of, ur10e_logs, ur10e_validation
from proofs.support.claims import Claim, data_folder, main_of


def _ur10e() -> list[Claim]:
    result = identified("ur10e_auto", ur10e_logs(), [ur10e_validation()])
    score, mix = result["validation"][0], mix_of(result)
    whole, moving = score["mean_percent"], score["mean_percent_moving"]
    return [
        Claim("UR10e, mean of the whole log", f"{whole:.2f} %", "<= 8.0 %", whole <= 8.0),
        Claim("UR10e, mean where joints move", f"{moving:.2f} %", "<= 5.0 %", moving <= 5.0),
        Claim("UR10e, chosen mix", mix, "with a memory", "maxwell" in mix or "dahl" in mix),
    ]


def _panda() -> list[Claim]:
    log = str(data_folder() / "panda" / "panda_gaz2019_trajectory1.parquet")
    result = identified("panda", [f"{log}@0.6:9.5"], [f"{log}@9.5:13.8"])
    pooled = result["validation"][0]["pooled_percent"]
    name = f"Panda, pooled ({mix_of(result)})"
    return [Claim(name, f"{pooled:.3f} %", "<= 1.55 %", pooled <= 1.55)]


def _ar5() -> list[Claim]:
    log = str(data_folder() / "rokae_ar5" / "ar5_run1_rows0_2300.parquet")
    runs = ["rokae_ar5_auto", "rokae_ar5"]
    auto, plain = (identified(name, [f"{log}@0:34"], [f"{log}@34:45"]) for name in runs)
    claims = []
    for figure in ("mean_percent", "pooled_percent"):
        ours, theirs = (_figure(result, figure) for result in (auto, plain))
        name = f"AR5, {figure.split('_')[0]} ({mix_of(auto)})"
        claims.append(
            Claim(name, f"{ours:.2f} %", f"<= {theirs:.2f} % (plain law)", ours <= theirs)
        )
    return claims


def _figure(result: dict[str, Any], name: str) -> float:
    return float(result["validation"][0][name])


def main() -> list[Claim]:
    """All three robots."""
    return [*_ur10e(), *_panda(), *_ar5()]


if __name__ == "__main__":
    main_of(main)

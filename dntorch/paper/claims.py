"""Each sentence of the paper beside our number, its interval and a verdict."""

from dntorch.paper.predictions import predictions
from dntorch.paper.statistics import ALPHA, summary, wilson
from dntorch.paper.study import Study
from dntorch.paper.verdict import UNTESTABLE, Claim, share, verdict

UNLEARNING = (
    "Learning in the exploitation phase consists primarily of unlearning incorrect 'shortcuts' "
    "inherited from the exploration phase"
)
ELSEWHERE = Claim(
    "we transferred a set of weights learned from a successful run of simulation to a real E-puck",
    "no robot is at hand",
    "–",
    UNTESTABLE,
)


def claims(study: Study) -> list[Claim]:
    """All claims of section IV and of the abstract that a run can decide."""
    r, p = study.results, predictions("main")
    return [
        *_exploration(r, p, study),
        *_learning(r, p),
        *_fast(r, p),
        *_level(r, p),
        *_law(r, p),
        ELSEWHERE,
    ]


def _exploration(r: dict, p: dict, study: Study) -> list[Claim]:
    mean, sd = r["behaviors_in_exploration"]
    wanted, within = (p["behaviors_in_exploration"][k] for k in ("predicted", "within"))
    e, fair = r["exploration"], p["exploration_uniform"]
    even = max(e["commonest"] - 1, 1 - e["rarest"]) <= fair["triples_within"]
    returns = abs(e["return_share"] - e["return_share_if_uniform"]) <= fair["returns_within"]
    first = summary(study.success.first[study.success.found] + 1)
    return [
        Claim(
            p["behaviors_in_exploration"]["paper"],
            f"mean number of behaviours in {study.config.explore} steps, {wanted} ± {within}",
            f"{mean:.1f} (sd {sd:.1f})",
            verdict(abs(mean - wanted) <= within, study.config.explore == 50_000),
        ),
        Claim(
            fair["paper"],
            "up to the first find each triple of successive behaviours is as frequent as any "
            f"other, within {fair['triples_within']:.0%}, and returns to the one before last as "
            f"chance has them, within {fair['returns_within']} (from {fair['transitions']:,} "
            "transitions on)",
            f"{e['transitions']:,} transitions; triples {e['rarest']:.3f} to {e['commonest']:.3f} "
            f"of their share, chi² = {e['chi2']:.0f}, {e['dof']} dof, p = {e['p']:.2g}; returns "
            f"{e['return_share']:.3f} instead of {e['return_share_if_uniform']:.3f}; "
            f"chance of the sequence a behaviour {e['chance_of_the_sequence']:.5f} instead of "
            f"{e['chance_if_uniform']:.5f}",
            verdict(even and returns, e["transitions"] >= fair["transitions"]),
        ),
        Claim(
            "Fig. (c) shows the time at which the sequence was first uncovered",
            "behaviours until the first find, of runs that found it while exploring",
            f"found {share(r['neural'], 'found')}; median {first['median']}, "
            f"quartiles {first['quartiles']}",
            UNTESTABLE,
        ),
    ]


def _learning(r: dict, p: dict) -> list[Claim]:
    neural, error = r["neural"], r["td_error"]
    k, n = neural["optimal_given_found"]
    low = wilson(k, n)[0]
    bound = p["optimal_given_found"]["at_least_lower_bound"]
    many = wilson(n, n)[0] >= bound
    unlearned, number = r["shortcuts"]["unlearned"]
    few = f" (no {bound} can be shown with {n} runs: all must be optimal)" if not many else ""
    first, last = error["at_first_find"], error["last_40"]
    ratio = last / first if first and last is not None else None
    fell = ratio is not None and ratio <= p["td_error"]["last_against_first_at_most"]
    return [
        Claim(
            p["optimal_given_found"]["paper"],
            f"P(optimal at the end | found), lower bound of at least {bound}{few}",
            share(neural, "optimal_given_found"),
            verdict(low >= bound if many else k == n, n > 0),
        ),
        Claim(
            p["late_share"]["paper"],
            "share of found runs whose values execute the sequence only later; at this rate one "
            "find is enough in nearly all, so that next to none is left: see the faster rate",
            share(neural, "optimal_only_in_exploitation"),
            UNTESTABLE,
        ),
        Claim(
            UNLEARNING,
            "of the runs that became optimal only then, those in which all shortcuts taken since "
            "had lost value; the longest choice by choice below",
            share(r["shortcuts"], "unlearned"),
            verdict(unlearned > number / 2, number > 0),
        ),
        Claim(
            p["td_error"]["paper"],
            "mean |TD error| of the last 40 transitions at most "
            f"{p['td_error']['last_against_first_at_most']} of that at the first reward",
            f"{last:.4f} against {first:.4f} (rewarded ones alone {error['last_40_rewarded']:.4f})"
            if first and last is not None else "no run found it",
            verdict(fell, ratio is not None),
        ),
    ]  # fmt: skip


def _fast(r: dict, p: dict) -> list[Claim]:
    """Where learning takes time: the agents at a faster rate."""
    fast, limits = r.get("fast"), p["fast"]
    if fast is None:
        return []
    late, found = fast["neural"]["optimal_only_in_exploitation"]
    unlearned, number = fast["shortcuts"]["unlearned"]
    optimal, _ = fast["neural"]["optimal_given_found"]
    low, wanted = wilson(late, found)[0], limits["late_lower_bound_at_least"]
    test, rate = fast["from_find_to_optimal"], f"at a learning rate of {fast['learning_rate']}/s"
    bound = limits["optimal_given_found_at_least_lower_bound"]
    return [
        Claim(
            limits["paper"],
            f"{rate}: share of found runs whose values execute the sequence only in exploitation, "
            f"lower bound of at least {wanted}",
            share(fast["neural"], "optimal_only_in_exploitation"),
            verdict(low >= wanted, found > 0),
        ),
        Claim(
            UNLEARNING,
            f"{rate}: of the runs that became optimal only then, those in which all shortcuts "
            "taken since had lost value",
            share(fast["shortcuts"], "unlearned"),
            verdict(unlearned > number / 2, number > 0),
        ),
        Claim(
            p["optimal_given_found"]["paper"],
            f"{rate}: P(optimal at the end | found), lower bound of at least {bound}",
            share(fast["neural"], "optimal_given_found"),
            verdict(wilson(optimal, found)[0] >= bound, wilson(found, found)[0] >= bound),
        ),
        Claim(
            p["equivalence"]["paper"],
            f"{rate}: behaviours from the find to the optimum, against discrete SARSA(λ) exploring "
            f"like the neural runs: two one-sided tests, margin {test['margin']}",
            f"ratio {test['ratio']:.3f}, p = {test['p']:.2g}" if test["ratio"] is not None else "–",
            verdict(test["p"] < ALPHA, test["decidable"]),
        ),
    ]


def _level(r: dict, p: dict) -> list[Claim]:
    rows = []
    for name, other in (("sarsa_matched", "exploring like the neural runs"),
                        ("sarsa", "exploring uniformly")):  # fmt: skip
        e = r["equivalence"][name]
        parts = [
            ("P(optimal | found)", "optimal_given_found", "difference"),
            ("share optimal only in exploitation", "optimal_only_in_exploitation", "difference"),
            (
                "behaviours until optimal (nearly all of them until the find)",
                "behaviors_to_optimal",
                "ratio",
            ),
        ]
        for what, key, number in parts:
            value = e[key][number]
            rows.append(
                Claim(
                    p["equivalence"]["paper"],
                    f"{what}, against discrete SARSA(λ) {other}: two one-sided tests, margin "
                    f"{e[key]['margin']}",
                    f"{number} {value:+.3f}, p = {e[key]['p']:.2g}" if value is not None else "–",
                    verdict(e[key]["p"] < ALPHA, e[key]["decidable"]),
                )
            )
    for name, sentence, bound in (
        ("td0", p["td0_optimal_given_found"]["paper"], p["td0_optimal_given_found"]["at_most"]),
        ("neural_single_item", p["single_item_optimal_given_found"]["paper"],
         p["single_item_optimal_given_found"]["at_most"]),
    ):  # fmt: skip
        k, n = r[name]["optimal_given_found"]
        label = "discrete TD(0)" if name == "td0" else "the same neural model, trace of one item"
        rows.append(
            Claim(sentence, f"P(optimal | found) of {label}, at most {bound}",
                  share(r[name], "optimal_given_found"),
                  verdict(wilson(k, n)[1] <= bound, wilson(k, n)[1] <= bound or k > bound * n))
        )  # fmt: skip
    return rows


def _law(r: dict, p: dict) -> list[Claim]:
    law, theory, limits = r["update_regression"], r["theory"], p["update_regression"]
    old, following, reward = (law[f"{k}_coefficient"] for k in ("old", "next", "reward"))
    known = law["transitions"] > 3
    near = known and abs(following / old - 1) <= limits["next_against_old_within"]
    near &= known and abs(reward / old - 1) <= limits["reward_against_old_within"]
    within = p["theory"]["within"]
    close = known and all(
        abs(law[f"{k}_coefficient"] / theory[k] - 1) <= within for k in ("old", "next", "reward")
    )
    close &= known and abs(law["decay"] / theory["decay"] - 1) <= within
    correlation, yoked, margin = r["yoked_correlation"], r["yoked"], p["yoked_correlation"]
    alike = correlation is not None and correlation >= margin["at_least"]
    alike = alike and abs(yoked["slope"] - 1) <= margin["slope_within"]
    alike = alike and yoked["rmse"] <= margin["rmse_at_most"]
    return [
        Claim(
            limits["paper"],
            f"R² of at least {limits['r2_at_least']}; coefficients of γQ(s',a') and of reward "
            "within 20 % of that of −Q(s,a)",
            f"R² = {law['r2']:.4f} ({law['transitions']} transitions); next {following:.4f}, old "
            f"{old:.4f}, reward {reward:.4f}" if known else "–",
            verdict(bool(near and law["r2"] >= limits["r2_at_least"]), bool(known)),
        ),
        Claim(
            "the working memory based eligibility trace values correspond to the SARSA "
            "eligibility trace values",
            f"effective learning rates and decay within {within:.0%} of what the parameters say",
            f"old {old:.4f} ({theory['old']:.4f}), next {following:.4f} ({theory['next']:.4f}), "
            f"reward {reward:.4f} ({theory['reward']:.4f}), γλ {law['decay']:.3f} "
            f"({theory['decay']:.3f})" if known else "–",
            verdict(bool(close), bool(known)),
        ),
        Claim(
            "the values of the weights … ultimately come to encode our desired Q-values",
            "against a discrete learner fed with the very transitions, end of exploration: "
            f"correlation at least {margin['at_least']}, slope within {margin['slope_within']} of "
            f"1, root mean square difference at most {margin['rmse_at_most']} of the largest value",
            f"{correlation:.4f}; slope {yoked['slope']:.3f}; difference {yoked['rmse']:.3f}"
            if correlation is not None else "–",
            verdict(alike, correlation is not None),
        ),
    ]  # fmt: skip

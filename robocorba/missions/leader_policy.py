"""Intervals, timeouts and limits of a leader."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class LeaderPolicy:
    """Intervals, timeouts and limits of a leader."""

    #: Time for robots to offer their help [s].
    offer_timeout_s: float = 3.0
    #: The same once enough robots have offered [s]: time for nearer ones.
    surplus_offer_timeout_s: float = 1.0
    #: Time for robots to answer an assignment [s].
    answer_timeout_s: float = 6.0
    #: The same after the first refusal [s]: no robot is kept waiting for a plan that has failed.
    timeout_after_refusal_s: float = 1.0
    #: Interval between repeated calls and assignments [s].
    repeat_interval_s: float = 0.5
    #: Time to reach an agreement while robots refuse or are busy [s].
    agreement_timeout_s: float = 60.0
    #: The same after a fault, also while robots are missing or servers don't answer [s].
    recovery_timeout_s: float = 60.0
    #: Time limit of waiting for areas while other missions use them, and the interval of that wait [s].
    areas_timeout_s: float = 1800.0
    areas_interval_s: float = 0.1
    #: Maximum number of attempts that begin after a fault.
    max_recoveries: int = 5
    #: Maximum random pause between attempts [s]. It separates leaders that compete for the same robots.
    max_retry_pause_s: float = 3.0
    #: Candidates beyond the helpers needed, the nearest first.
    spare_candidates: int = 4
    #: Interval between order messages [s].
    order_interval_s: float = 0.1
    #: Lead time of a step: time for its order to reach all members before it begins [s].
    step_lead_s: float = 0.3
    #: Lead time of a change of the carry's rate [s].
    rate_change_lead_s: float = 0.15
    #: The attempt ends after this time without status messages from a member [s], unless the others can go on.
    member_timeout_s: float = 4.0
    #: While all hold an object they wait this much longer [s] for a silent member that is still on its floor, and go on
    #: without one that is gone.
    gone_timeout_s: float = 15.0
    #: Time for members to report to a leader that takes over, and for which it measures their clocks [s].
    report_timeout_s: float = 3.0
    clock_measuring_s: float = 0.5
    #: The carry pauses after this time without status messages from a member [s].
    carry_pause_timeout_s: float = 0.5
    #: The attempt ends if a step exceeds its limit by this time [s]; members detect it first.
    step_grace_s: float = 3.0
    #: Time for members to end safely [s].
    end_timeout_s: float = 25.0
    #: Time for robots to step aside, and to answer that they will [s]. One without an agent for missions does not.
    aside_timeout_s: float = 30.0
    aside_answer_timeout_s: float = 3.0
    #: How far ahead the way of a carry is watched, and how far ahead it must be free for the body to go on [s of its
    #: trajectory].
    look_ahead_s: float = 4.0
    stop_ahead_s: float = 2.0
    #: Distance between the poses of the body that are examined [s], and interval between looks [s].
    look_step_s: float = 0.25
    look_interval_s: float = 0.1
    #: Others are expected to move on as now for this time [s].
    predicted_s: float = 1.0
    #: What is nearer to the body than this is in its way [m]; plans keep more from what they know.
    way_gap_m: float = 0.02
    #: The carry stops once what is around it is unknown for this time [s].
    unknown_timeout_s: float = 1.0
    #: It goes on once its way has been free for this time [s].
    settle_s: float = 0.5
    #: Share of the planned speed with which it approaches what is in its way.
    approach_rate: float = 0.5
    #: The attempt ends if something stays in the way of a carry for this time [s].
    way_timeout_s: float = 20.0
    #: The carry runs at half rate if a carrier's position error exceeds this [m].
    slow_error_m: float = 0.06
    #: The carry pauses if a carrier's position error exceeds this [m].
    stop_error_m: float = 0.12


DEFAULT_POLICY = LeaderPolicy()

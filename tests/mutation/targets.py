"""Which tests are to notice a change of which module. Kernels are left out: a plain implementation stands beside each."""

TARGETS: dict[str, tuple[str, ...]] = {
    "handtrack.sampling.chain_vote": ("tests/sampling/test_chain_vote.py",),
    "handtrack.sampling.hypotheses": ("tests/sampling/test_hypotheses.py",),
    "handtrack.tracking.hypotheses.mixture": ("tests/tracking/decisions/test_mixture_weights.py",),
    "handtrack.tracking.hypotheses.mixture_landscape": (
        "tests/tracking/decisions/test_hypothesis_rounds.py",
        "tests/tracking/decisions/test_mixture_weights.py",
    ),
    "handtrack.tracking.hypotheses.first_hypotheses": (
        "tests/tracking/decisions/test_hypothesis_rounds.py",
        "tests/tracking/decisions/test_mixture_weights.py",
    ),
    "handtrack.tracking.hypotheses.next_hypotheses": (
        "tests/tracking/decisions/test_hypothesis_rounds.py",
        "tests/tracking/decisions/test_mixture_weights.py",
    ),
    "handtrack.tracking.hypotheses.mixture_terms": (
        "tests/tracking/decisions/test_mixture_weights.py",
    ),
    "handtrack.tracking.frame.prediction": (
        "tests/tracking/decisions/test_prediction_span.py",
        "tests/tracking/test_prediction.py",
    ),
    "handtrack.tracking.frame.assessment": (
        "tests/tracking/decisions/test_status.py",
        "tests/tracking/test_assessment.py",
    ),
    "handtrack.tracking.frame.terms.cloud_terms": (
        "tests/tracking/decisions/test_cloud_balance.py",
        "tests/tracking/test_cloud_weight.py",
        "tests/tracking/test_methods.py",
    ),
    "handtrack.tracking.search.proposers.finger_moves": (
        "tests/tracking/decisions/test_finger_shift.py",
    ),
    "handtrack.tracking.search.policy": (
        "tests/tracking/decisions/test_restart_choice.py",
        "tests/tracking/test_search_policy.py",
        "tests/tracking/decisions/test_status.py",
    ),
    "handtrack.tracking.search.engine": (
        "tests/tracking/test_search_policy.py",
        "tests/tracking/decisions/test_hypothesis_rounds.py",
    ),
    "handtrack.tracking.search.poor_cloud": (
        "tests/tracking/decisions/test_poor_cloud.py",
        "tests/tracking/test_fallback.py",
    ),
}

"""What every cause of misfit of displacement says of itself."""

from inverse.diagnosis import HMI_CAUSES

REQUIRED = (
    "thermocouple-viscous-heating thermocouple-lag thermocouple-position normalisation-temperature "
    "tracking-compression tracking-jitter thermal-decorrelation echo-strain thermal-lens path-heating "
    "attenuation-kinetics scattering-fraction exponent-change sound-speed-change perfusion conductivity-change "
    "pre-ablation-softening lesion-rim damage-law lesion-stiffness-law fractional-tissue cavitation boiling "
    "output-drift acoustic-saturation near-boundary"
).split()


def test_library_holds_the_names_that_users_write():
    assert [cause.name for cause in HMI_CAUSES] == list(dict.fromkeys(cause.name for cause in HMI_CAUSES))
    assert set(REQUIRED) <= {cause.name for cause in HMI_CAUSES}
    for cause in HMI_CAUSES:
        assert cause.sentence.endswith(".") and cause.helps.endswith(".") and cause.source and cause.unit
        assert cause.plausible > 0.0 and cause.sign in (0, 1) and ":" in cause.place

from das.advice.regimes import Regime
from sim.drivers.cab import CabView
from sim.drivers.knowledge import LineKnowledge
from sim.drivers.skills import NotchedLever, Skills, WanderingError
from sim.plant.plant import Command, lever


class Gentle:
    """Keeps time by notches, brakes gently, and coasts when it is advised."""

    def __init__(self, line: LineKnowledge, seed: int = 0) -> None:
        self.skills = Skills(line, braking_mps2=0.4, below_mps=3 / 3.6)
        self.notches = NotchedLever(10)
        self.misjudged = WanderingError(seed, deviation=0.5, correlation_s=30.0)

    def command(self, cab: CabView) -> Command:
        """What the controller is set to for the next 0.2 s."""
        skills = self.skills.see(cab)
        if skills.cab.shall_stand:
            return lever(0.0)
        advice = cab.shown
        if advice and advice.mode == Regime.COAST:
            wanted = 0.0
        else:
            wanted = skills.hold(skills.timely_mps() + self.misjudged.at(cab.time_s))
        return lever(self.notches.set(wanted, skills.most()))

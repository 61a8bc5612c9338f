"""The bar of work that goes through stages."""

import inverse
from inverse.commands.console import done_of, staged_bar
from inverse.commands.diagnose import STAGES
from inverse.datasets.shipped import shipped

TWO = {"draws": 10.0, "pushes": 30.0, "fit": 60.0}


def test_stages_that_are_counted_fill_their_part():
    assert done_of("draws 5 of 10", TWO) == 5.0
    assert done_of("pushes 1 of 3", TWO) == 20.0
    assert done_of("fit", TWO) == 40.0
    assert done_of("draws 0 of 0", TWO) == 0.0


def test_words_of_no_stage_leave_the_bar_where_it_is():
    assert done_of("compiling", TWO) == 0.0
    with staged_bar("work", TWO) as show:
        for words in ("fit", "compiling", "draws 1 of 2"):
            show(words)


def test_a_diagnosis_goes_through_its_stages_in_order():
    said = []
    inverse.diagnose(shipped("pyvisco_polymer"), model="zener", causes=["power-law-relaxation"], on_step=said.append)
    done = [done_of(words, STAGES["dma"]) for words in said]
    # But for measurements that would separate causes: of one alone there is none.
    assert done == sorted(done) and len(set(done)) == len(STAGES["dma"]) - 1, said

"""What makes plans of many rooms quick."""

from fipt.config.planned import look_up_once


class Index:
    """Stands in for the workflow system's: notes what it is asked."""

    def __init__(self):
        self.asked = []

    def match_producers(self, targetfile):
        self.asked.append(targetfile)
        return {f"rule of {targetfile}"}


def test_the_rule_of_a_file_is_searched_once():
    look_up_once(Index)
    look_up_once(Index)  # a second workflow in the process
    one, other = Index(), Index()
    assert [one.match_producers(name) for name in "aba"] == [{"rule of a"}, {"rule of b"}, {"rule of a"}]
    assert other.match_producers("a") == {"rule of a"}
    assert (one.asked, other.asked) == (["a", "b"], ["a"])

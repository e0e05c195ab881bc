"""What every representation, method and ranking must do, as checks for the tests of plug-in authors.

    import swarmwright.testing

    def test_conformance():
        swarmwright.testing.check_method("my_method")

A check raises AssertionError that says what is violated. The same checks run over everything built in.
"""

from swarmwright.testing._methods import check_method
from swarmwright.testing._rankings import check_ranking
from swarmwright.testing._representations import check_representation

__all__ = ["check_method", "check_ranking", "check_representation"]

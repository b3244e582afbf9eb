import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--rays", type=int, default=20_000, help="rays a family and scheme in test_conformance.py"
    )

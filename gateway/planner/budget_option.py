"""Option `--uncertainty-budget` of `treadlink estimate`."""

from typing import Final

from gateway.core.cli.estimate_outputs import AddedOutput
from gateway.core.cli.path_option import path_option

BUDGET: Final = AddedOutput(
    factory="gateway.planner.budget_output:open_budgets",
    parameter="budget_path",
    option=path_option(
        "--uncertainty-budget",
        "budget_path",
        help="Write what each statement adds to the last errors to this JSON file, and list what to state better.",
    ),
)

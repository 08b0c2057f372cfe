"""The line that ends a run: units, and nothing where nothing is known."""

from hsslam_services.processes.evaluator import evaluation_line


def test_errors_are_in_centimetres_and_shares_in_percent():
    ate = {"online": {"rmse_m": 0.0123}, "final": {"rmse_m": 0.001}, "keyframes": {"rmse_m": None}}
    mesh = {"accuracy_mean_m": 0.0072, "completion_ratio_5cm": 0.985}
    expected = "ATE: online 1.23 cm, final 0.10 cm"
    assert evaluation_line({"ate": ate}) == expected
    with_mesh = f"{expected}; mesh: 0.72 cm off, 98.5 % complete within 5 cm"
    assert evaluation_line({"ate": ate, "mesh": mesh}) == with_mesh
    assert evaluation_line({"ate": {"final": {"rmse_m": None}}}) == "ATE: no poses to compare"

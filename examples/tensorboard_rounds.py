"""A callback: accuracy, objective and arrivals of every round for TensorBoard.

pip install tensorboard torch
aerofed run --out out --set 'callbacks=["examples.tensorboard_rounds:make"]'
tensorboard --logdir out/tensorboard
"""

from dataclasses import dataclass

from torch.utils.tensorboard import SummaryWriter

from aerofed import CallbackContext, RoundReport


@dataclass(frozen=True)
class TensorBoard:
    """Writes events into the run's folder."""

    writer: SummaryWriter

    def round_finished(self, report: RoundReport) -> None:
        """A resumed run tells its finished rounds again, for which a step replaces itself."""
        number, record = report.round.round, report.round
        self.writer.add_scalar("objective/planned", record.plan_objective, number)
        self.writer.add_scalar("objective/true", record.true_objective, number)
        self.writer.add_scalar("arrivals", record.delivered, number)
        for community, accuracy in record.accuracy.items():
            self.writer.add_scalar(f"accuracy/{community}", accuracy, number)

    def close(self) -> None:
        self.writer.close()


def make(context: CallbackContext) -> TensorBoard:
    """What `callbacks` names."""
    return TensorBoard(SummaryWriter(context.folder / "tensorboard"))

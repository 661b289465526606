"""Where networks train, looked for before anything is loaded or flown."""

from fl.errors import SettingError


def check_device(device: str) -> None:
    """Raise `SettingError` where "cuda" is asked for and torch sees no such device."""
    if device == "cuda":
        # Imported here: torch takes seconds, which nobody else need wait for.
        from fl.training.modules.cuda import is_there

        if not is_there():
            raise SettingError(
                "learning.device", device, "must be 'cpu': torch sees no CUDA device"
            )

"""Where details of mistakes are kept, in the user's own folder; light to import."""

from __future__ import annotations

from handtrack.session.bundled import user_data_folder

LOG_FILE = user_data_folder() / "logs" / "workbench.log"

"""Where details of mistakes are kept: files of the user's own; light to import."""

from __future__ import annotations

from handtrack.files.user_folder import user_data_folder

LOG_FILE = user_data_folder() / "logs" / "workbench.log"
"""what the page's process notes"""
ENGINE_LOG = LOG_FILE.with_name("engine.log")
"""what the engine's process, and libraries in it, print"""

//! Scenes packed for the passes.

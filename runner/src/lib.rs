//! weir, the library: scenes, the frame graph, its two executors, and what the command line does with them.

pub mod exit;
pub mod output;
pub mod scene;

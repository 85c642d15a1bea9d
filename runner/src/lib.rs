//! weir, the library: scenes, the frame graph, its two executors, and what the command line does with them.

pub mod executor;
pub mod graph;
pub mod packed;
pub mod exit;
pub mod output;
pub mod scene;
pub mod technique;

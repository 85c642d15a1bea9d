//! weir, the library: scenes, the frame graph, its two executors, and what the command line does with them.

pub mod bench;
pub mod budget;
pub mod crosscheck;
pub mod executor;
pub mod exit;
pub mod faults;
pub mod graph;
pub mod margin;
pub mod output;
pub mod packed;
pub mod reference;
pub mod render;
pub mod scene;
pub mod sequence;
pub mod settings;
pub mod shaders;
pub mod skips;
pub mod stress;
pub mod technique;
#[cfg(feature = "window")]
pub mod view;

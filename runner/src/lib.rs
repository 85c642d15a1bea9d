//! weir, the library: scenes, the frame graph, its two executors, and what the command line does with them.

pub mod scene;
pub mod shaders;

//! The desktop viewer.
//!
//! A window and a thread: the window reads what a person does, draws panels, and shows the newest picture; the thread
//! computes pictures of what the window wants. So the window answers while a frame takes its time.

pub mod accumulation;
pub mod app;
pub mod buffers;
pub mod driver;
pub mod engine;
pub mod exposure;
mod gallery;
mod input;
pub mod keys;
pub mod lights;
pub mod navigation;
pub mod panels;
pub mod pick;
pub mod save;
pub mod screen;
pub mod script;
pub mod state;
pub mod stats;
pub mod stored;
pub mod want;
pub mod watch;
pub mod worker;

//! What both processors share: buffer layouts and the mathematics of every pass.
#![cfg_attr(target_arch = "spirv", no_std)]

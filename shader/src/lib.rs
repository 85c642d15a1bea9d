//! The passes of weir, one file each.
#![cfg_attr(target_arch = "spirv", no_std)]

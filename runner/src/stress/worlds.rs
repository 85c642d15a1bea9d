//! Worlds of a few lights, small enough to enumerate every outcome of an estimator.

pub mod random;
pub mod walk;
pub mod world;

/// Largest relative error of an expectation that rounding may leave.
pub const ROUNDING: f64 = 1e-12;

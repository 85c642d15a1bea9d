//! The estimators by enumeration: expectations over all outcomes of small cases, exact up to rounding.
//!
//! The core of reuse is generic over the float and over the way of choosing. Here it runs in `f64`, and in place of
//! random numbers a [`walk::Walk`] takes every decision both ways.

mod choices;
mod fuzz;
mod neighbors;
mod planted;
mod unbiased;

use weir::stress::worlds::{ROUNDING, walk, world};

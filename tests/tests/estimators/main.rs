//! The estimators by enumeration: expectations over all outcomes of small cases, exact up to rounding.
//!
//! The core of reuse is generic over the float and over the way of choosing. Here it runs in `f64`, and in place of
//! random numbers a [`walk::Walk`] takes every decision both ways.

mod choices;
mod fuzz;
mod neighbors;
mod planted;
mod unbiased;
mod walk;
mod world;

/// Largest relative error of an expectation that rounding may leave.
const ROUNDING: f64 = 1e-12;

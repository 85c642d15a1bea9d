//! Samplers against the densities that they report, and the weights of what they find against the measure they stand
//! for.

mod candidates;
mod cells;
mod picks;
mod places;
mod rays;

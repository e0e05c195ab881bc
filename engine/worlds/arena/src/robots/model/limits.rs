//! Limits of the numbers in a robot model, and checks against them.

use swarmwright_simulation::ParameterError;
use swarmwright_simulation::parameters::wrong;

/// Limits of noise, of the range of rays and of neighbour detection in metres, of the reach of light, and of
/// probabilities.
pub(super) const NOISE: [f32; 2] = [0.0, 1.0];
pub(super) const RAYS: [f32; 2] = [0.001, 100.0];
pub(super) const RANGE: [f32; 2] = [0.001, 1000.0];
pub(super) const REACH: [f32; 2] = [0.001, 1000.0];
pub(super) const SHARE: [f32; 2] = [0.0, 1.0];
/// Limits of a robot's mass, kilograms.
pub(super) const MASSES: [f32; 2] = [0.001, 1000.0];
/// Limits of a compass's noise, degrees.
pub(super) const TURNED: [f32; 2] = [0.0, 180.0];

/// Checks that a list is not empty and has no duplicates.
pub(super) fn each_once<T: PartialEq>(name: &str, list: &[T]) -> Result<(), ParameterError> {
    let twice = |index: usize| list[..index].contains(&list[index]);
    if list.is_empty() {
        return Err(wrong(name, "expected at least one"));
    }
    match (0..list.len()).find(|index| twice(*index)) {
        Some(index) => Err(wrong(&format!("{name}[{index}]"), "occurs twice")),
        None => Ok(()),
    }
}

pub(super) fn within(name: &str, number: f32, [low, high]: [f32; 2]) -> Result<(), ParameterError> {
    if (low..=high).contains(&number) {
        return Ok(());
    }
    Err(wrong(
        name,
        format!("{number} found, expected {low} to {high}"),
    ))
}

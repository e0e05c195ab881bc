//! Specifications of Mealy machines.

use super::MealyFsm;
use crate::reader::{Reader, excerpt, wrong};
use crate::{MAX_WEIGHTS, SpecificationError};

pub(super) fn read(reader: &mut Reader<'_>) -> Result<MealyFsm, SpecificationError> {
    let sensors = reader.count("sensors", 1, MAX_WEIGHTS)?;
    Ok(MealyFsm {
        sensors,
        actuators: reader.count("actuators", 1, MAX_WEIGHTS)?,
        states: reader.count("states", 1, MAX_WEIGHTS)?,
        thresholds: thresholds(reader, sensors)?,
    })
}

/// A list for each sensor, of finite binary32 numbers, ascending.
fn thresholds(
    reader: &mut Reader<'_>,
    sensors: usize,
) -> Result<Vec<Vec<f32>>, SpecificationError> {
    let expected =
        format!("a list of {sensors} lists of ascending numbers, such as [[-0.5, 0.5], [0]]");
    let raw = reader.raw("thresholds", &expected)?;
    let mismatch = || format!("{} found, expected {expected}", excerpt(raw));
    let thresholds: Vec<Vec<f32>> =
        serde_json::from_str(raw.get()).map_err(|_| wrong("thresholds", mismatch()))?;
    if thresholds.len() != sensors {
        return Err(wrong("thresholds", mismatch()));
    }
    let ascends = |of_one: &[f32]| of_one.windows(2).all(|pair| pair[0] < pair[1]);
    let valid = |of_one: &Vec<f32>| ascends(of_one) && of_one.iter().all(|t| t.is_finite());
    match thresholds.iter().position(|of_one| !valid(of_one)) {
        None => Ok(thresholds),
        Some(i) => Err(wrong(
            &format!("thresholds[{i}]"),
            "must hold finite binary32 numbers, each greater than the one before",
        )),
    }
}

//! Mealy machines: finite-state machines whose outputs depend on the state and on the sensors.

mod lanes;

use super::Kind;
use crate::reader::{Reader, excerpt, wrong};
use crate::{MAX_WEIGHTS, SpecificationError};
use serde::Serialize;

/// A Mealy machine (G. H. Mealy, "A method for synthesizing sequential circuits", 1955) over thresholded sensors.
///
/// Thresholds cut the range of each sensor into intervals. The intervals that all sensors are in make a symbol, and
/// state and symbol together name a row of the table: what to do now, and the state of the next step. The first step
/// is made in state 0.
///
/// Weights: row after row, the state of the next step, then one number for every actuator. Rows are in mixed radix:
/// the state is the most significant digit, then the first sensor, and the last sensor's interval changes from row to row.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MealyFsm {
    /// Numbers in.
    pub sensors: usize,
    /// Numbers out.
    pub actuators: usize,
    /// States that it can be in.
    pub states: usize,
    /// For each sensor: where one interval ends and the next begins, ascending; none for a sensor that is ignored.
    pub thresholds: Vec<Vec<f32>>,
}

impl MealyFsm {
    /// Weights in a row of the table.
    fn row_length(&self) -> usize {
        1 + self.actuators
    }

    /// The highest number of a state.
    fn last_state(&self) -> f32 {
        // Far below 2^24, so that every state is a binary32.
        (self.states - 1) as f32
    }
}

impl Kind for MealyFsm {
    const SIZE: (&'static str, &'static str) = ("thresholds", "use fewer states or thresholds");

    fn read(reader: &mut Reader<'_>) -> Result<Self, SpecificationError> {
        let sensors = reader.count("sensors", 1, MAX_WEIGHTS)?;
        Ok(Self {
            sensors,
            actuators: reader.count("actuators", 1, MAX_WEIGHTS)?,
            states: reader.count("states", 1, MAX_WEIGHTS)?,
            thresholds: thresholds(reader, sensors)?,
        })
    }

    fn weight_count(&self) -> Option<usize> {
        let mut intervals = self.thresholds.iter().map(|of_one| of_one.len() + 1);
        let rows = intervals.try_fold(self.states, usize::checked_mul)?;
        rows.checked_mul(self.row_length())
    }

    fn sensors(&self) -> usize {
        self.sensors
    }

    fn actuators(&self) -> usize {
        self.actuators
    }

    /// The number of the state.
    fn state_length(&self) -> usize {
        1
    }

    fn scratch_length(&self) -> usize {
        0
    }

    fn current(&self, state: &[f32]) -> Option<u32> {
        state.first().map(|number| *number as u32)
    }

    #[inline]
    fn step(
        &self,
        weights: &[f32],
        state: &mut [f32],
        _scratch: &mut [f32],
        sensors: &[f32],
        actuators: &mut [f32],
    ) {
        let state = &mut state[0];
        let mut row = *state as usize;
        for (sensor, thresholds) in sensors.iter().zip(&self.thresholds) {
            row *= thresholds.len() + 1;
            row += thresholds.iter().filter(|t| **t < *sensor).count();
        }
        let row = &weights[row * self.row_length()..][..self.row_length()];
        let next = if row[0] < 0.0 { 0.0 } else { row[0] };
        let last = self.last_state();
        *state = if next > last { last } else { next }.trunc();
        for (actuator, output) in actuators.iter_mut().zip(&row[1..]) {
            let a = if *output > 1.0 { 1.0 } else { *output };
            *actuator = if a < -1.0 { -1.0 } else { a };
        }
    }
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

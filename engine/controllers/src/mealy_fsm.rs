//! Mealy machines: finite-state machines whose outputs depend on the state and on what is sensed.

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
    /// For each sensor: where one interval ends and the next begins, ascending; none where it is not looked at.
    pub thresholds: Vec<Vec<f32>>,
}

impl MealyFsm {
    pub(crate) fn weight_count(&self) -> Option<usize> {
        let mut intervals = self.thresholds.iter().map(|of_one| of_one.len() + 1);
        let rows = intervals.try_fold(self.states, usize::checked_mul)?;
        rows.checked_mul(self.row_length())
    }

    /// Weights in a row of the table.
    pub(crate) fn row_length(&self) -> usize {
        1 + self.actuators
    }

    /// The highest number of a state.
    pub(crate) fn last_state(&self) -> f32 {
        // Far below 2^24, so that every state is a binary32.
        (self.states - 1) as f32
    }

    /// `state`: one number, kept between steps.
    pub(crate) fn step(
        &self,
        weights: &[f32],
        state: &mut f32,
        sensors: &[f32],
        actuators: &mut [f32],
    ) {
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

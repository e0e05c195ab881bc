//! Steps along a gradient, scaled by running means of it and of its square (Kingma and Ba, "Adam", ICLR 2015, with its defaults).

const FIRST: f64 = 0.9;
const SECOND: f64 = 0.999;
const TINY: f64 = 1e-8;

/// The state of Adam.
#[derive(Debug, Clone)]
pub(super) struct Adam {
    step: f64,
    mean: Vec<f64>,
    square: Vec<f64>,
    first_left: f64,
    second_left: f64,
}

impl Adam {
    /// `step`: length of the first step in each direction.
    pub(super) fn new(step: f64, size: usize) -> Self {
        Self {
            step,
            mean: vec![0.0; size],
            square: vec![0.0; size],
            first_left: 1.0,
            second_left: 1.0,
        }
    }

    /// Puts the step to make in the place of the gradient.
    pub(super) fn climb(&mut self, gradient: &mut [f64]) {
        self.first_left *= FIRST;
        self.second_left *= SECOND;
        let size = self.step * (1.0 - self.second_left).sqrt() / (1.0 - self.first_left);
        let running = self.mean.iter_mut().zip(&mut self.square);
        for (value, (mean, square)) in gradient.iter_mut().zip(running) {
            *mean = FIRST * *mean + (1.0 - FIRST) * *value;
            *square = SECOND * *square + (1.0 - SECOND) * *value * *value;
            *value = size * *mean / (square.sqrt() + TINY);
        }
    }

    /// The running mean of the gradient.
    pub(super) fn mean(&self) -> &[f64] {
        &self.mean
    }
}

//! Inference in lanes: many controllers of one architecture at once, bit for bit as one at a time.
//!
//! The operations and their order are those of [`crate::Controller`]; a lane never meets another one.

use swarmwright_lanes::{Lanes, Mask};

use crate::functions::lanes as functions;
use crate::{Activation, Architecture, FullyMeshed, Layered, OutputRange};

/// As many controllers as there are lanes, with their weights; the state of each agent is kept by the caller.
pub struct LaneController<'a, L> {
    architecture: &'a Architecture,
    /// One vector per weight.
    weights: Vec<L>,
    scratch: Vec<L>,
}

impl<'a, L: Lanes> LaneController<'a, L> {
    /// Controllers without weights; `load` gives them some.
    #[inline(always)]
    pub fn new(architecture: &'a Architecture) -> Self {
        let scratch = match architecture {
            Architecture::Layered(net) => net.scratch_length(),
            Architecture::FullyMeshed(net) => 2 * (net.hidden + net.actuators),
        };
        Self {
            architecture,
            weights: vec![L::splat(0.0); architecture.weight_count()],
            scratch: vec![L::splat(0.0); scratch],
        }
    }

    /// Gives each lane the weights of a genome; `genomes` holds one per lane, each as long as the weight count.
    #[inline(always)]
    pub fn load(&mut self, genomes: &[&[f32]]) {
        let mut lanes = [0.0; 64];
        for (index, weight) in self.weights.iter_mut().enumerate() {
            for (lane, genome) in lanes.iter_mut().zip(genomes) {
                *lane = genome[index];
            }
            *weight = L::load(&lanes);
        }
    }

    /// Vectors of state that one agent needs; all 0 at the start of an episode.
    #[inline(always)]
    pub fn state_length(&self) -> usize {
        match self.architecture {
            Architecture::Layered(_) => 0,
            Architecture::FullyMeshed(net) => net.hidden + net.actuators,
        }
    }

    /// One step of one agent: `state` is its own, as long as `state_length`.
    #[inline(always)]
    pub fn step(&mut self, state: &mut [L], sensors: &[L], actuators: &mut [L]) {
        let (weights, scratch) = (self.weights.as_slice(), self.scratch.as_mut_slice());
        macro_rules! with {
            ($function:ty) => {
                match self.architecture {
                    Architecture::Layered(net) => {
                        layered::<L, $function>(net, weights, scratch, sensors, actuators);
                    }
                    Architecture::FullyMeshed(net) => {
                        fully_meshed::<L, $function>(
                            net, weights, state, scratch, sensors, actuators,
                        );
                    }
                }
            };
        }
        match self.architecture.activation() {
            Activation::Tanh => with!(Tanh),
            Activation::Sigmoid => with!(Sigmoid),
            Activation::Relu => with!(Relu),
            Activation::Clamp => with!(Clamp),
            Activation::Linear => with!(Linear),
        }
    }
}

/// An activation as a type: unlike a closure it is inlined wherever it is used, and so compiled for the instruction set.
trait Function {
    fn apply<L: Lanes>(a: L) -> L;
}

macro_rules! functions {
    ($($name:ident: $a:ident => $value:expr;)*) => {$(
        struct $name;
        impl Function for $name {
            #[inline(always)]
            fn apply<L: Lanes>($a: L) -> L {
                $value
            }
        }
    )*};
}

functions! {
    Tanh: a => functions::tanh(a);
    Sigmoid: a => functions::sigmoid(a);
    Relu: a => a.at_least(L::splat(0.0));
    Clamp: a => a.at_least(L::splat(0.0)).at_most(L::splat(1.0));
    Linear: a => a;
}

/// 0, then each product added in turn.
#[inline(always)]
fn sum<L: Lanes>(start: L, weights: &[L], inputs: &[L]) -> L {
    let mut sum = start;
    for (weight, input) in weights.iter().zip(inputs) {
        sum = sum.add(weight.mul(*input));
    }
    sum
}

#[inline(always)]
fn layered<L: Lanes, F: Function>(
    net: &Layered,
    weights: &[L],
    scratch: &mut [L],
    sensors: &[L],
    actuators: &mut [L],
) {
    let (mut below, mut above) = scratch.split_at_mut(scratch.len() / 2);
    below[..sensors.len()].copy_from_slice(sensors);
    let mut width = net.sensors;
    let mut rest = weights;
    for nodes in net.layers() {
        let (layer, behind) = rest.split_at(nodes * (width + 1));
        for (output, row) in above.iter_mut().zip(layer.chunks_exact(width + 1)) {
            *output = F::apply(row[0].add(sum(L::splat(0.0), &row[1..], below)));
        }
        (below, above) = (above, below);
        (width, rest) = (nodes, behind);
    }
    for (actuator, output) in actuators.iter_mut().zip(below.iter()) {
        *actuator = limited(net.output_range, *output);
    }
}

#[inline(always)]
fn fully_meshed<L: Lanes, F: Function>(
    net: &FullyMeshed,
    weights: &[L],
    state: &mut [L],
    scratch: &mut [L],
    sensors: &[L],
    actuators: &mut [L],
) {
    let active = net.hidden + net.actuators;
    let (state, sensors) = (&mut state[..active], &sensors[..net.sensors]);
    let (heard, next) = scratch.split_at_mut(active);
    let row_length = net.nodes() + 1;
    // Sensors come first in every sum and do not change within a step, so their part of it is the same in every
    // iteration, to the bit.
    for (heard, row) in heard.iter_mut().zip(weights.chunks_exact(row_length)) {
        *heard = sum(L::splat(0.0), &row[1..=net.sensors], sensors);
    }
    for _ in 0..net.iterations {
        for ((next, heard), row) in next
            .iter_mut()
            .zip(heard.iter())
            .zip(weights.chunks_exact(row_length))
        {
            *next = F::apply(row[0].add(sum(*heard, &row[1 + net.sensors..], state)));
        }
        state.copy_from_slice(&next[..active]);
    }
    for (actuator, output) in actuators.iter_mut().zip(&state[net.hidden..]) {
        *actuator = limited(net.output_range, *output);
    }
}

/// As `OutputRange::actuator`.
#[inline(always)]
fn limited<L: Lanes>(range: OutputRange, output: L) -> L {
    let (one, two) = (L::splat(1.0), L::splat(2.0));
    let a = if range == OutputRange::SYMMETRIC {
        output
    } else if range == OutputRange::UNIT {
        two.mul(output).sub(one)
    } else {
        let (low, high) = range.bounds();
        output
            .sub(L::splat(low))
            .div(L::splat(high - low))
            .mul(two)
            .sub(one)
    };
    let nan = a.is_nan();
    let a = if nan.any() {
        L::splat(0.0).select(a, nan)
    } else {
        a
    };
    a.at_most(one).at_least(L::splat(-1.0))
}

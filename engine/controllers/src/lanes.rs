//! Inference in lanes: many controllers of one architecture at once, bit for bit as one at a time.
//!
//! The operations and their order are those of [`crate::Controller`]; a lane never meets another one.

use std::hint::black_box;

use swarmwright_lanes::{Int, Lanes, MOST_LANES, Mask};

use crate::functions::lanes as functions;
use crate::{Activation, Architecture, FullyMeshed, Layered, MealyFsm, OutputRange};

/// As many controllers as there are lanes, with their weights; the state of each agent is kept by the caller.
pub struct LaneController<'a, L> {
    architecture: &'a Architecture,
    /// One vector per weight; none for machines.
    weights: Vec<L>,
    /// The weights of each lane, which machines look up.
    genomes: Vec<&'a [f32]>,
    scratch: Vec<L>,
}

impl<'a, L: Lanes> LaneController<'a, L> {
    /// Controllers without weights; `load` gives them some.
    #[inline(always)]
    pub fn new(architecture: &'a Architecture) -> Self {
        let count = architecture.weight_count();
        let (weights, scratch) = match architecture {
            Architecture::Layered(net) => (count, net.scratch_length()),
            Architecture::FullyMeshed(net) => (count, 2 * (net.hidden + net.actuators)),
            Architecture::MealyFsm(machine) => (0, machine.sensors),
            Architecture::ParameterSet(_) => (0, 0),
        };
        Self {
            architecture,
            weights: vec![L::splat(0.0); weights],
            genomes: Vec::new(),
            scratch: vec![L::splat(0.0); scratch],
        }
    }

    /// Gives each lane the weights of a genome; `genomes` holds one per lane, each as long as the weight count.
    #[inline(always)]
    pub fn load(&mut self, genomes: &[&'a [f32]]) {
        if self.weights.is_empty() {
            self.genomes.clear();
            self.genomes.extend_from_slice(genomes);
        } else {
            L::transpose(genomes, 0, &mut self.weights);
        }
    }

    /// Vectors of state that one agent needs; all 0 at the start of an episode.
    #[inline(always)]
    pub fn state_length(&self) -> usize {
        match self.architecture {
            Architecture::Layered(_) | Architecture::ParameterSet(_) => 0,
            Architecture::FullyMeshed(net) => net.hidden + net.actuators,
            Architecture::MealyFsm(_) => 1,
        }
    }

    /// One step of one agent: `state` is its own, as long as `state_length`.
    #[inline(always)]
    pub fn step<const S: usize>(&mut self, state: &mut [L], sensors: [L; S], actuators: &mut [L]) {
        self.step_with_bits(state, sensors, (L::Int::splat(0), []), actuators);
        for actuator in actuators {
            *actuator = limited(*actuator);
        }
    }

    /// The same, where the last sensors are 1 or 0: 1 where a bit of `bits` is not set; `order` says which bits, the
    /// lowest one being 0. That takes half the operations for them.
    ///
    /// Actuators are as the network gives them: not limited to -1..1, and NaN not replaced by 0. That is less work, and
    /// enough for whoever only asks on which side of some number they are.
    #[inline(always)]
    pub fn step_with_bits<const S: usize, const B: usize>(
        &mut self,
        state: &mut [L],
        numbers: [L; S],
        (bits, order): (L::Int, [u32; B]),
        actuators: &mut [L],
    ) {
        let (weights, scratch) = (self.weights.as_slice(), self.scratch.as_mut_slice());
        match self.architecture {
            Architecture::Layered(net) => {
                // A copy for networks that go through sensors in a loop, so that for others they may stay in registers.
                let copy = numbers;
                let sensors = Inputs::new(&copy, bits, &order);
                layered(net, weights, scratch, sensors, actuators);
            }
            Architecture::FullyMeshed(net) => {
                // A handful of nodes, as in the built-in examples, stay in registers from iteration to iteration.
                match net.hidden + net.actuators {
                    3 => small::<L, 3>(net, weights, state, Inputs::new(&numbers, bits, &order)),
                    4 => small::<L, 4>(net, weights, state, Inputs::new(&numbers, bits, &order)),
                    _ => {
                        let copy = numbers;
                        let sensors = Inputs::new(&copy, bits, &order);
                        large(net, weights, state, scratch, sensors);
                    }
                }
                for (actuator, output) in actuators.iter_mut().zip(&state[net.hidden..]) {
                    *actuator = stretched(net.output_range, *output);
                }
            }
            Architecture::MealyFsm(machine) => {
                for (sensor, number) in scratch.iter_mut().zip(numbers) {
                    *sensor = number;
                }
                for (sensor, bit) in scratch[S..].iter_mut().zip(order) {
                    *sensor = L::splat(1.0).select(L::splat(0.0), is_one::<L>(bits, bit));
                }
                mealy_fsm(machine, &self.genomes, &mut state[0], scratch, actuators);
            }
            // Parameters differ from lane to lane, so that no simulation runs parameter sets in lanes.
            Architecture::ParameterSet(_) => {}
        }
    }
}

/// Inputs of a sum: numbers, and then bits of an integer: 1 where they are not set, else 0.
#[derive(Clone, Copy)]
struct Inputs<'a, L: Lanes> {
    numbers: &'a [L],
    bits: L::Int,
    order: &'a [u32],
}

impl<'a, L: Lanes> Inputs<'a, L> {
    #[inline(always)]
    fn new(numbers: &'a [L], bits: L::Int, order: &'a [u32]) -> Self {
        Self {
            numbers,
            bits,
            order,
        }
    }

    #[inline(always)]
    fn of_numbers(numbers: &'a [L]) -> Self {
        Self::new(numbers, L::Int::splat(0), &[])
    }

    #[inline(always)]
    fn len(self) -> usize {
        self.numbers.len() + self.order.len()
    }
}

/// Whether a sensor that is a bit is 1: whether the bit is not set. The contrary would take two instructions where this
/// takes one, since the compiler would turn it into this and swap what is chosen.
#[inline(always)]
fn is_one<L: Lanes>(bits: L::Int, bit: u32) -> L::Mask {
    bits.and(L::Int::splat(1 << bit)).eq(L::Int::splat(0))
}

/// The activation function. The choice is made anew for each node, and always the same: the processor foresees it, and the
/// code stays small, which counts since all of it is compiled for every instruction set.
#[inline(always)]
fn apply<L: Lanes>(activation: Activation, a: L) -> L {
    match activation {
        Activation::Tanh => functions::tanh(a),
        Activation::Sigmoid => functions::sigmoid(a),
        Activation::Relu => relu(a),
        Activation::Clamp => clamp(a),
        Activation::Linear => a,
    }
}

#[inline(always)]
fn relu<L: Lanes>(a: L) -> L {
    a.at_least(L::splat(0.0))
}

#[inline(always)]
fn clamp<L: Lanes>(a: L) -> L {
    a.at_least(L::splat(0.0)).at_most(L::splat(1.0))
}

/// The products of one row of weights with the inputs, added to `start` in their order.
#[inline(always)]
fn add_row<L: Lanes>(start: L, weights: &[L], inputs: Inputs<'_, L>) -> L {
    add_rows([start], [weights], inputs)[0]
}

/// The same for `N` rows at once: their sums do not wait for each other, and an input is read once for all.
///
/// A sensor of 1 or 0 adds a weight or nothing, where the product would be the weight or a zero. That gives the same bits: a sum
/// that began with +0 is never -0, and to anything else a zero of either sign adds nothing.
#[inline(always)]
fn add_rows<L: Lanes, const N: usize>(
    mut sums: [L; N],
    rows: [&[L]; N],
    inputs: Inputs<'_, L>,
) -> [L; N] {
    let numbers = inputs.numbers.len();
    let mut cut: [&[L]; N] = [&[]; N];
    for node in 0..N {
        cut[node] = &rows[node][..inputs.len()];
    }
    for (j, input) in inputs.numbers.iter().enumerate() {
        for node in 0..N {
            sums[node] = sums[node].add(cut[node][j].mul(*input));
        }
    }
    for (j, bit) in inputs.order.iter().enumerate() {
        let is_one = is_one::<L>(inputs.bits, *bit);
        for node in 0..N {
            sums[node] = sums[node].add_where(cut[node][numbers + j], is_one);
        }
    }
    sums
}

/// `N` slices of `length`, one after another, each without its first `from` weights.
#[inline(always)]
fn split<L, const N: usize>(rows: &[L], length: usize, from: usize) -> [&[L]; N] {
    let mut split: [&[L]; N] = [&[]; N];
    for node in 0..N {
        split[node] = &rows[node * length..][from..length];
    }
    split
}

/// A layer of nodes: the sum of the products, then the bias, then the function.
#[inline(always)]
fn layer<L: Lanes>(activation: Activation, rows: &[L], inputs: Inputs<'_, L>, outputs: &mut [L]) {
    let length = inputs.len() + 1;
    let mut fours = outputs.chunks_exact_mut(4);
    let mut rest = rows;
    for four in &mut fours {
        let sums = add_rows([L::splat(0.0); 4], split::<L, 4>(rest, length, 1), inputs);
        for node in 0..4 {
            four[node] = apply(activation, rest[node * length].add(sums[node]));
        }
        rest = &rest[4 * length..];
    }
    for output in fours.into_remainder() {
        *output = apply(
            activation,
            rest[0].add(add_row(L::splat(0.0), &rest[1..length], inputs)),
        );
        rest = &rest[length..];
    }
}

#[inline(always)]
fn layered<L: Lanes>(
    net: &Layered,
    weights: &[L],
    scratch: &mut [L],
    sensors: Inputs<'_, L>,
    actuators: &mut [L],
) {
    let (mut below, mut above) = scratch.split_at_mut(scratch.len() / 2);
    let mut width = net.sensors;
    let mut rest = weights;
    let mut inputs = sensors;
    for nodes in net.layers() {
        let (rows, behind) = rest.split_at(nodes * (width + 1));
        layer(net.activation, rows, inputs, &mut above[..nodes]);
        (below, above) = (above, below);
        (width, rest) = (nodes, behind);
        inputs = Inputs::of_numbers(&below[..width]);
    }
    for (actuator, output) in actuators.iter_mut().zip(inputs.numbers) {
        *actuator = stretched(net.output_range, *output);
    }
}

/// The same for the sums of several nodes: one choice for all.
#[inline(always)]
fn apply_to<L: Lanes, const N: usize>(activation: Activation, mut sums: [L; N]) -> [L; N] {
    macro_rules! each {
        ($function:expr) => {
            for sum in &mut sums {
                *sum = $function(*sum);
            }
        };
    }
    match activation {
        Activation::Tanh => each!(functions::tanh),
        Activation::Sigmoid => each!(functions::sigmoid),
        Activation::Relu => each!(relu),
        Activation::Clamp => each!(clamp),
        Activation::Linear => {}
    }
    sums
}

/// A fully meshed network of `N` nodes that are no sensors.
///
/// Sensors come first in every sum and do not change within a step, so their part of it is the same in every
/// iteration, to the bit.
#[inline(always)]
fn small<L: Lanes, const N: usize>(
    net: &FullyMeshed,
    weights: &[L],
    state: &mut [L],
    sensors: Inputs<'_, L>,
) {
    let length = sensors.len() + N + 1;
    let weights = &weights[..N * length];
    let heard = add_rows(
        [L::splat(0.0); N],
        split::<L, N>(weights, length, 1),
        sensors,
    );
    let mut outputs = [L::splat(0.0); N];
    outputs.copy_from_slice(&state[..N]);
    for _ in 0..net.iterations {
        // The compiler shall not know that these are the same weights each time: it would load them all before the
        // first iteration, into more registers than there are, and so copy them to the stack.
        let weights = &black_box(weights)[..N * length];
        let rows = split::<L, N>(weights, length, 1 + sensors.len());
        let mut sums = add_rows(heard, rows, Inputs::of_numbers(&outputs));
        for node in 0..N {
            sums[node] = weights[node * length].add(sums[node]);
        }
        outputs = apply_to(net.activation, sums);
    }
    state[..N].copy_from_slice(&outputs);
}

/// A fully meshed network of any size.
#[inline(always)]
fn large<L: Lanes>(
    net: &FullyMeshed,
    weights: &[L],
    state: &mut [L],
    scratch: &mut [L],
    sensors: Inputs<'_, L>,
) {
    let active = net.hidden + net.actuators;
    let length = net.nodes() + 1;
    let (heard, next) = scratch[..2 * active].split_at_mut(active);
    for (heard, row) in heard.iter_mut().zip(weights.chunks_exact(length)) {
        *heard = add_row(L::splat(0.0), &row[1..], sensors);
    }
    for _ in 0..net.iterations {
        for ((next, heard), row) in next
            .iter_mut()
            .zip(heard.iter())
            .zip(weights.chunks_exact(length))
        {
            *next = apply(
                net.activation,
                row[0].add(add_row(
                    *heard,
                    &row[1 + net.sensors..],
                    Inputs::of_numbers(&state[..active]),
                )),
            );
        }
        state[..active].copy_from_slice(next);
    }
}

#[inline(always)]
fn mealy_fsm<L: Lanes>(
    machine: &MealyFsm,
    genomes: &[&[f32]],
    state: &mut L,
    sensors: &[L],
    actuators: &mut [L],
) {
    let (zero, one) = (L::Int::splat(0), L::Int::splat(1));
    let mut row = state.floor();
    for (sensor, thresholds) in sensors.iter().zip(&machine.thresholds) {
        // A specification has at most a million weights, so no row comes near 2^31.
        row = row.mul(L::Int::splat(thresholds.len() as i32 + 1));
        for threshold in thresholds {
            row = row.add(one.select(zero, L::splat(*threshold).lt(*sensor)));
        }
    }
    let mut at = [0; MOST_LANES];
    row.mul(L::Int::splat(machine.row_length() as i32))
        .store(&mut at);
    let mut column = [0.0; MOST_LANES];
    let mut gather = |offset: usize| {
        for lane in 0..L::WIDTH {
            column[lane] = genomes[lane][at[lane] as usize + offset];
        }
        L::load(&column)
    };
    for (index, actuator) in actuators.iter_mut().enumerate() {
        *actuator = gather(1 + index)
            .at_most(L::splat(1.0))
            .at_least(L::splat(-1.0));
    }
    let next = gather(0)
        .at_least(L::splat(0.0))
        .at_most(L::splat(machine.last_state()));
    *state = L::from_int(next.floor());
}

/// An output of the range as an actuator; what lies outside of the range stays outside.
#[inline(always)]
fn stretched<L: Lanes>(range: OutputRange, output: L) -> L {
    let (one, two) = (L::splat(1.0), L::splat(2.0));
    if range == OutputRange::SYMMETRIC {
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
    }
}

/// What `OutputRange::actuator` does after that.
#[inline(always)]
fn limited<L: Lanes>(a: L) -> L {
    let nan = a.is_nan();
    let a = if nan.any() {
        L::splat(0.0).select(a, nan)
    } else {
        a
    };
    a.at_most(L::splat(1.0)).at_least(L::splat(-1.0))
}

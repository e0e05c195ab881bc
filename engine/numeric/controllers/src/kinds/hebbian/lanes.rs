//! Networks with Hebbian learning in lanes.

use swarmwright_lanes::{Lanes, MOST_LANES, Mask};

use super::{Hebbian, delta, half_delta};
use crate::kinds::{Kind, LaneKind};
use crate::lanes::nodes::{apply, stretched};
use crate::lanes::sums::{Inputs, add_row, is_one};
use crate::{Activation, OutputRange};

impl LaneKind for Hebbian {
    #[inline(always)]
    fn lane_weights(&self) -> usize {
        self.weight_count().unwrap_or(usize::MAX)
    }

    /// What the weights learn, or the outputs of the next iteration; then the sensors.
    #[inline(always)]
    fn lane_scratch_length(&self) -> usize {
        self.scratch_length() + self.sensors
    }

    #[inline(always)]
    fn step_in_lanes<L: Lanes, const S: usize, const B: usize>(
        &self,
        (weights, _): (&[L], &[&[f32]]),
        state: &mut [L],
        scratch: &mut [L],
        numbers: [L; S],
        (bits, order): (L::Int, [u32; B]),
        actuators: &mut [L],
    ) {
        let (scratch, sensors) = scratch.split_at_mut(self.scratch_length());
        for (sensor, number) in sensors.iter_mut().zip(numbers) {
            *sensor = number;
        }
        for (sensor, bit) in sensors[S..].iter_mut().zip(order) {
            *sensor = L::splat(1.0).select(L::splat(0.0), is_one::<L>(bits, bit));
        }
        self.forward(weights, state, scratch, sensors, actuators);
    }

    #[inline(always)]
    fn step_slice_in_lanes<L: Lanes>(
        &self,
        (weights, _): (&[L], &[&[f32]]),
        state: &mut [L],
        scratch: &mut [L],
        sensors: &[L],
        actuators: &mut [L],
    ) {
        self.forward(weights, state, scratch, sensors, actuators);
    }
}

impl Hebbian {
    #[inline(always)]
    fn forward<L: Lanes>(
        &self,
        weights: &[L],
        state: &mut [L],
        scratch: &mut [L],
        sensors: &[L],
        actuators: &mut [L],
    ) {
        let nodes = self.nodes();
        let (rate, genes) = (weights[0], &weights[1..]);
        let (begun, rest) = state.split_at_mut(1);
        let (outputs, links) = rest.split_at_mut(nodes);
        begin(&mut begun[0], links, genes, nodes);
        outputs[..self.sensors].copy_from_slice(sensors);
        for _ in 0..self.iterations {
            let rows = links.chunks_exact(nodes).zip(genes.chunks_exact(nodes + 1));
            for (next, (row, genes)) in scratch.iter_mut().zip(rows) {
                let sum = add_row(L::splat(0.0), row, Inputs::of_numbers(outputs));
                *next = apply(Activation::Clamp, genes[0].add(sum));
            }
            outputs[self.sensors..].copy_from_slice(&scratch[..self.active()]);
        }
        self.learn_in_lanes(rate, outputs, links, scratch);
        for (actuator, output) in actuators
            .iter_mut()
            .zip(&outputs[self.sensors + self.hidden..])
        {
            *actuator = stretched(OutputRange::UNIT, *output);
        }
    }

    /// As [`Hebbian::learn`]. Products are those of binary64, which lanes do not have: one lane after another.
    #[inline(always)]
    fn learn_in_lanes<L: Lanes>(&self, rate: L, outputs: &[L], links: &mut [L], deltas: &mut [L]) {
        let nodes = self.nodes();
        let (mut rates, mut numbers) = ([0.0; MOST_LANES], [0.0; MOST_LANES]);
        rate.store(&mut rates);
        let mut sum = L::splat(0.0);
        for (node, row) in deltas.chunks_exact_mut(nodes).enumerate() {
            let mut halves = [0.0; MOST_LANES];
            outputs[self.sensors + node].store(&mut numbers);
            for lane in 0..L::WIDTH {
                halves[lane] = half_delta(rates[lane], numbers[lane]);
            }
            for (source, to) in row.iter_mut().enumerate() {
                outputs[source].store(&mut numbers);
                for lane in 0..L::WIDTH {
                    numbers[lane] = delta(halves[lane], numbers[lane]);
                }
                *to = L::load(&numbers);
                if source != self.sensors + node {
                    sum = sum.add(*to);
                }
            }
        }
        let mean = sum.div(L::splat(self.learning()));
        let rows = links
            .chunks_exact_mut(nodes)
            .zip(deltas.chunks_exact(nodes));
        for (node, (row, deltas)) in rows.enumerate() {
            for (source, (weight, delta)) in row.iter_mut().zip(deltas).enumerate() {
                if source != self.sensors + node {
                    *weight = weight.add(delta.sub(mean));
                }
            }
        }
    }
}

/// Where an episode begins, its weights are those of the genome.
#[inline(always)]
fn begin<L: Lanes>(begun: &mut L, links: &mut [L], genes: &[L], nodes: usize) {
    let first = begun.le(L::splat(0.0));
    if !first.any() {
        return;
    }
    *begun = L::splat(1.0);
    for (row, genes) in links
        .chunks_exact_mut(nodes)
        .zip(genes.chunks_exact(nodes + 1))
    {
        for (weight, gene) in row.iter_mut().zip(&genes[1..]) {
            *weight = gene.select(*weight, first);
        }
    }
}

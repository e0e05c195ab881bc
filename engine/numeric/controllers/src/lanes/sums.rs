//! Sums of products of weights and inputs, in lanes.

use swarmwright_lanes::{Int, Lanes};

/// Inputs of a sum: numbers, and then bits of an integer: 1 where they are not set, else 0.
#[derive(Clone, Copy)]
pub(crate) struct Inputs<'a, L: Lanes> {
    pub(crate) numbers: &'a [L],
    pub(crate) bits: L::Int,
    pub(crate) order: &'a [u32],
}

impl<'a, L: Lanes> Inputs<'a, L> {
    #[inline(always)]
    pub(crate) fn new(numbers: &'a [L], bits: L::Int, order: &'a [u32]) -> Self {
        Self {
            numbers,
            bits,
            order,
        }
    }

    #[inline(always)]
    pub(crate) fn of_numbers(numbers: &'a [L]) -> Self {
        Self::new(numbers, L::Int::splat(0), &[])
    }

    #[inline(always)]
    pub(crate) fn len(self) -> usize {
        self.numbers.len() + self.order.len()
    }
}

/// Whether a sensor that is a bit is 1: whether the bit is not set. The opposite would take two instructions where this
/// takes one, since the compiler would turn it into this and swap the operands of the selection.
#[inline(always)]
pub(crate) fn is_one<L: Lanes>(bits: L::Int, bit: u32) -> L::Mask {
    bits.and(L::Int::splat(1 << bit)).eq(L::Int::splat(0))
}

/// Sensors as numbers: those that are, and then those that are bits.
#[inline(always)]
pub(crate) fn write_numbers<L: Lanes, const S: usize, const B: usize>(
    sensors: &mut [L],
    numbers: [L; S],
    (bits, order): (L::Int, [u32; B]),
) {
    for (sensor, number) in sensors.iter_mut().zip(numbers) {
        *sensor = number;
    }
    for (sensor, bit) in sensors.iter_mut().skip(S).zip(order) {
        *sensor = L::splat(1.0).select(L::splat(0.0), is_one::<L>(bits, bit));
    }
}

/// The products of one row of weights with the inputs, added to `start` in their order.
#[inline(always)]
pub(crate) fn add_row<L: Lanes>(start: L, weights: &[L], inputs: Inputs<'_, L>) -> L {
    add_rows([start], [weights], inputs)[0]
}

/// The same for `N` rows at once: their sums do not wait for each other, and an input is read once for all.
///
/// A sensor of 1 or 0 adds a weight or nothing, where the product would be the weight or a zero. That gives the same bits: a sum
/// that began with +0 is never -0, and to anything else a zero of either sign adds nothing.
#[inline(always)]
pub(crate) fn add_rows<L: Lanes, const N: usize>(
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
pub(crate) fn split<L, const N: usize>(rows: &[L], length: usize, from: usize) -> [&[L]; N] {
    let mut split: [&[L]; N] = [&[]; N];
    for node in 0..N {
        split[node] = &rows[node * length..][from..length];
    }
    split
}

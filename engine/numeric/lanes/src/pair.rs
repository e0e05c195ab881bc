//! Twice the lanes: two vectors side by side, so that a processor that waits for one works on the other.

use crate::{Int, Lanes, Mask, in_order};

/// Two vectors as one of twice the width.
///
/// A rollout is one long chain in which each operation waits for the one before; two chains that do not wait for each
/// other keep the processor busy. Use it where there are enough episodes, and registers are not short.
#[derive(Debug, Clone, Copy)]
// One vector after the other, see `in_order`.
#[repr(C)]
pub struct Pair<L>(L, L);

/// Conditions of a [`Pair`].
#[derive(Debug, Clone, Copy)]
pub struct PairMask<L: Lanes>(L::Mask, L::Mask);

/// Integers of a [`Pair`].
#[derive(Debug, Clone, Copy)]
pub struct PairInt<L: Lanes>(L::Int, L::Int);

macro_rules! both {
    ($($name:ident($($other:ident),*);)*) => {$(
        #[inline(always)]
        fn $name(self, $($other: Self),*) -> Self {
            Self(self.0.$name($($other.0),*), self.1.$name($($other.1),*))
        }
    )*};
}

macro_rules! compare {
    ($($name:ident($($other:ident),*);)*) => {$(
        #[inline(always)]
        fn $name(self, $($other: Self),*) -> PairMask<L> {
            PairMask(self.0.$name($($other.0),*), self.1.$name($($other.1),*))
        }
    )*};
}

impl<L: Lanes> Lanes for Pair<L> {
    const WIDTH: usize = 2 * L::WIDTH;
    type Mask = PairMask<L>;
    type Int = PairInt<L>;

    #[inline(always)]
    fn apart<T>(part: impl FnOnce() -> T) -> T {
        L::apart(part)
    }
    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self(L::splat(value), L::splat(value))
    }
    #[inline(always)]
    fn load(from: &[f32]) -> Self {
        let (low, high) = from.split_at(L::WIDTH);
        Self(L::load(low), L::load(high))
    }
    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        let (low, high) = to.split_at_mut(L::WIDTH);
        self.0.store(low);
        self.1.store(high);
    }
    #[inline(always)]
    fn numbers(&self) -> &[f32] {
        in_order::numbers(self)
    }
    #[inline(always)]
    fn numbers_mut(&mut self) -> &mut [f32] {
        in_order::numbers_mut(self)
    }
    both! {
        add(other);
        sub(other);
        mul(other);
        neg();
        div(other);
        sqrt();
        at_most(limit);
        at_least(limit);
    }
    compare! {
        lt(other);
        le(other);
        is_nan();
    }
    #[inline(always)]
    fn select(self, other: Self, condition: PairMask<L>) -> Self {
        Self(
            self.0.select(other.0, condition.0),
            self.1.select(other.1, condition.1),
        )
    }
    #[inline(always)]
    fn add_where(self, other: Self, condition: PairMask<L>) -> Self {
        Self(
            self.0.add_where(other.0, condition.0),
            self.1.add_where(other.1, condition.1),
        )
    }
    #[inline(always)]
    fn floor(self) -> PairInt<L> {
        PairInt(self.0.floor(), self.1.floor())
    }
    #[inline(always)]
    fn from_int(int: PairInt<L>) -> Self {
        Self(L::from_int(int.0), L::from_int(int.1))
    }
    #[inline(always)]
    fn pattern(self) -> PairInt<L> {
        PairInt(self.0.pattern(), self.1.pattern())
    }
    #[inline(always)]
    fn from_pattern(pattern: PairInt<L>) -> Self {
        Self(L::from_pattern(pattern.0), L::from_pattern(pattern.1))
    }
    #[inline(always)]
    fn transpose(rows: &[&[f32]], from: usize, columns: &mut [Self]) {
        const TILE: usize = 16;
        let (low, high) = rows.split_at(L::WIDTH);
        for (tile, columns) in columns.chunks_mut(TILE).enumerate() {
            let from = from + tile * TILE;
            let mut halves = [[L::splat(0.0); TILE]; 2];
            L::transpose(low, from, &mut halves[0][..columns.len()]);
            L::transpose(high, from, &mut halves[1][..columns.len()]);
            for (index, column) in columns.iter_mut().enumerate() {
                *column = Self(halves[0][index], halves[1][index]);
            }
        }
    }
}

impl<L: Lanes> Mask for PairMask<L> {
    #[inline(always)]
    fn bits(self) -> u64 {
        self.0.bits() | self.1.bits() << L::WIDTH
    }
    #[inline(always)]
    fn from_bits(bits: u64) -> Self {
        Self(
            L::Mask::from_bits(bits),
            L::Mask::from_bits(bits >> L::WIDTH),
        )
    }
    both! {
        and(other);
        or(other);
        and_not(other);
    }
}

impl<L: Lanes> Int for PairInt<L> {
    type Mask = PairMask<L>;

    #[inline(always)]
    fn splat(value: i32) -> Self {
        Self(L::Int::splat(value), L::Int::splat(value))
    }
    #[inline(always)]
    fn load(from: &[i32]) -> Self {
        let (low, high) = from.split_at(L::WIDTH);
        Self(L::Int::load(low), L::Int::load(high))
    }
    #[inline(always)]
    fn store(self, to: &mut [i32]) {
        let (low, high) = to.split_at_mut(L::WIDTH);
        self.0.store(low);
        self.1.store(high);
    }
    both! {
        add(other);
        sub(other);
        mul(other);
        and(other);
        or(other);
        xor(other);
        shl(other);
        shr(other);
        shr_signed(other);
    }
    compare! {
        eq(other);
        lt(other);
    }
    #[inline(always)]
    fn select(self, other: Self, condition: PairMask<L>) -> Self {
        Self(
            self.0.select(other.0, condition.0),
            self.1.select(other.1, condition.1),
        )
    }
    #[inline(always)]
    fn lookup_eight(self, table: &[i32; 8]) -> Self {
        Self(self.0.lookup_eight(table), self.1.lookup_eight(table))
    }
    #[inline(always)]
    fn lookup(self, table: &[i32]) -> Self {
        Self(self.0.lookup(table), self.1.lookup(table))
    }
    #[inline(always)]
    fn lookup_where(self, table: &[i32], other: Self, condition: PairMask<L>) -> Self {
        Self(
            self.0.lookup_where(table, other.0, condition.0),
            self.1.lookup_where(table, other.1, condition.1),
        )
    }
    #[inline(always)]
    fn lookup_bytes(self, bytes: &[u8]) -> Self {
        Self(self.0.lookup_bytes(bytes), self.1.lookup_bytes(bytes))
    }
    #[inline(always)]
    fn lookup_bytes_where(self, bytes: &[u8], other: Self, condition: PairMask<L>) -> Self {
        Self(
            self.0.lookup_bytes_where(bytes, other.0, condition.0),
            self.1.lookup_bytes_where(bytes, other.1, condition.1),
        )
    }
}

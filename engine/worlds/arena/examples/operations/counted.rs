//! Sixteen lanes that count their operations.
//!
//! Numbers and integers are computed as in the engine's scalar lanes. Operations that a compiler removes or merges into
//! others are not counted: splats, loads, stores, and bitwise operations on masks.

use std::cell::Cell;

use swarmwright_lanes::{Int, Lanes, Mask};

/// Number of lanes in a vector.
pub const WIDTH: usize = 16;

/// Kinds of operations.
#[derive(Clone, Copy)]
enum Kind {
    Vector,
    Integer,
    Divide,
    SquareRoot,
    ScalarLoad,
}

thread_local! {
    static COUNTS: [Cell<u64>; 5] = const { [const { Cell::new(0) }; 5] };
}

fn count(kind: Kind, operations: u64) {
    COUNTS.with(|counts| {
        let count = &counts[kind as usize];
        count.set(count.get() + operations);
    });
}

/// Returns this thread's operations so far: on vectors of numbers, on integers, divisions, square roots, and scalar
/// loads.
pub fn counts() -> [u64; 5] {
    COUNTS.with(|counts| std::array::from_fn(|kind| counts[kind].get()))
}

/// One number per lane.
#[derive(Clone, Copy)]
pub struct Numbers([f32; WIDTH]);

/// One integer per lane.
#[derive(Clone, Copy)]
pub struct Integers([i32; WIDTH]);

/// One condition per lane.
#[derive(Clone, Copy)]
pub struct Conditions([bool; WIDTH]);

fn each<A: Copy, B: Copy, C>(a: [A; WIDTH], b: [B; WIDTH], f: impl Fn(A, B) -> C) -> [C; WIDTH] {
    std::array::from_fn(|lane| f(a[lane], b[lane]))
}

/// Defines lane-wise operations of two vectors; each line gives the kind, the result type and the names.
macro_rules! binary {
    ($Scalar:ty, $Trait:ident: $($kind:ident $Result:ident $($name:ident)*;)*) => {$($(
        fn $name(self, other: Self) -> $Result {
            count(Kind::$kind, 1);
            $Result(each(self.0, other.0, <$Scalar as $Trait>::$name))
        }
    )*)*};
}

impl Lanes for Numbers {
    const WIDTH: usize = WIDTH;
    type Mask = Conditions;
    type Int = Integers;

    binary! {
        f32, Lanes:
        Vector Numbers add sub mul at_most at_least;
        Divide Numbers div;
        Vector Conditions lt le;
    }

    fn numbers(&self) -> &[f32] {
        &self.0
    }

    fn numbers_mut(&mut self) -> &mut [f32] {
        &mut self.0
    }

    fn splat(value: f32) -> Self {
        Self([value; WIDTH])
    }
    fn load(from: &[f32]) -> Self {
        Self(std::array::from_fn(|lane| from[..WIDTH][lane]))
    }
    fn store(self, to: &mut [f32]) {
        to[..WIDTH].copy_from_slice(&self.0);
    }
    fn add_where(self, other: Self, condition: Conditions) -> Self {
        count(Kind::Vector, 1);
        Self(std::array::from_fn(|lane| {
            self.0[lane].add_where(other.0[lane], condition.0[lane])
        }))
    }
    fn neg(self) -> Self {
        count(Kind::Vector, 1);
        Self(self.0.map(Lanes::neg))
    }
    fn sqrt(self) -> Self {
        count(Kind::SquareRoot, 1);
        Self(self.0.map(f32::sqrt))
    }
    fn is_nan(self) -> Conditions {
        count(Kind::Vector, 1);
        Conditions(self.0.map(Lanes::is_nan))
    }
    fn select(self, other: Self, condition: Conditions) -> Self {
        count(Kind::Vector, 1);
        Self(std::array::from_fn(|lane| {
            self.0[lane].select(other.0[lane], condition.0[lane])
        }))
    }
    fn floor(self) -> Integers {
        count(Kind::Vector, 1);
        Integers(self.0.map(Lanes::floor))
    }
    fn from_int(int: Integers) -> Self {
        count(Kind::Vector, 1);
        Self(int.0.map(<f32 as Lanes>::from_int))
    }
    fn pattern(self) -> Integers {
        Integers(self.0.map(Lanes::pattern))
    }
    fn from_pattern(pattern: Integers) -> Self {
        Self(pattern.0.map(<f32 as Lanes>::from_pattern))
    }
}

impl Mask for Conditions {
    fn bits(self) -> u64 {
        (0..WIDTH).fold(0, |bits, lane| bits | u64::from(self.0[lane]) << lane)
    }
    fn from_bits(bits: u64) -> Self {
        Self(std::array::from_fn(|lane| bits >> lane & 1 == 1))
    }
    fn and(self, other: Self) -> Self {
        Self(each(self.0, other.0, Mask::and))
    }
    fn or(self, other: Self) -> Self {
        Self(each(self.0, other.0, Mask::or))
    }
    fn and_not(self, other: Self) -> Self {
        Self(each(self.0, other.0, Mask::and_not))
    }
}

impl Int for Integers {
    type Mask = Conditions;

    binary! {
        i32, Int:
        Integer Integers add sub mul and or xor shl shr shr_signed;
        Integer Conditions eq lt;
    }

    fn splat(value: i32) -> Self {
        Self([value; WIDTH])
    }
    fn load(from: &[i32]) -> Self {
        Self(std::array::from_fn(|lane| from[..WIDTH][lane]))
    }
    fn store(self, to: &mut [i32]) {
        to[..WIDTH].copy_from_slice(&self.0);
    }
    fn select(self, other: Self, condition: Conditions) -> Self {
        count(Kind::Integer, 1);
        Self(std::array::from_fn(|lane| {
            self.0[lane].select(other.0[lane], condition.0[lane])
        }))
    }
    fn lookup_eight(self, table: &[i32; 8]) -> Self {
        count(Kind::Integer, 1);
        Self(self.0.map(|index| index.lookup_eight(table)))
    }
    fn lookup(self, table: &[i32]) -> Self {
        count(Kind::ScalarLoad, WIDTH as u64);
        Self(self.0.map(|index| index.lookup(table)))
    }
    fn lookup_bytes(self, bytes: &[u8]) -> Self {
        count(Kind::ScalarLoad, WIDTH as u64);
        Self(self.0.map(|index| index.lookup_bytes(bytes)))
    }
}

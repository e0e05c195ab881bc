//! Vectors of lanes with the operators of numbers.

use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

use crate::Lanes;

/// A vector of lanes that is written as a number: `a * b + c` is `a.mul(b).add(c)`, neither fused nor reordered.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(transparent)]
pub struct Number<L>(pub L);

/// The same number in every lane.
#[inline(always)]
pub fn number<L: Lanes>(value: f32) -> Number<L> {
    Number(L::splat(value))
}

impl<L: Lanes> Number<L> {
    /// The correctly rounded square root.
    #[inline(always)]
    #[must_use]
    pub fn sqrt(self) -> Self {
        Self(self.0.sqrt())
    }

    /// The smaller of both; a NaN in self passes.
    #[inline(always)]
    #[must_use]
    pub fn at_most(self, limit: Self) -> Self {
        Self(self.0.at_most(limit.0))
    }

    /// The larger of both; a NaN in self passes.
    #[inline(always)]
    #[must_use]
    pub fn at_least(self, limit: Self) -> Self {
        Self(self.0.at_least(limit.0))
    }

    /// Limited to low..=high.
    #[inline(always)]
    #[must_use]
    pub fn within(self, low: f32, high: f32) -> Self {
        self.at_most(number(high)).at_least(number(low))
    }

    /// self < other; false for NaN.
    #[inline(always)]
    pub fn lt(self, other: Self) -> L::Mask {
        self.0.lt(other.0)
    }

    /// self <= other; false for NaN.
    #[inline(always)]
    pub fn le(self, other: Self) -> L::Mask {
        self.0.le(other.0)
    }

    /// self > other; false for NaN.
    #[inline(always)]
    pub fn gt(self, other: Self) -> L::Mask {
        other.0.lt(self.0)
    }

    /// self where the condition holds, else other.
    #[inline(always)]
    #[must_use]
    pub fn select(self, other: Self, condition: L::Mask) -> Self {
        Self(self.0.select(other.0, condition))
    }

    /// self where the condition holds, else 0.
    #[inline(always)]
    #[must_use]
    pub fn only_where(self, condition: L::Mask) -> Self {
        self.select(number(0.0), condition)
    }

    /// self + other where the condition holds, else self.
    #[inline(always)]
    #[must_use]
    pub fn add_where(self, other: Self, condition: L::Mask) -> Self {
        Self(self.0.add_where(other.0, condition))
    }

    /// The first `WIDTH` numbers of a slice. Panics when there are fewer.
    #[inline(always)]
    #[must_use]
    pub fn load(from: &[f32]) -> Self {
        Self(L::load(from))
    }

    /// Into the first `WIDTH` places of a slice. Panics when there are fewer.
    #[inline(always)]
    pub fn store(self, to: &mut [f32]) {
        self.0.store(to);
    }

    /// The number of a lane. Panics where there is no such lane.
    #[inline(always)]
    #[must_use]
    pub fn lane(&self, lane: usize) -> f32 {
        self.0.numbers()[lane]
    }

    /// Changes the number of a lane. Panics where there is no such lane.
    #[inline(always)]
    pub fn set_lane(&mut self, lane: usize, number: f32) {
        self.0.numbers_mut()[lane] = number;
    }
}

macro_rules! operators {
    ($($Trait:ident $name:ident $Assign:ident $assign:ident;)*) => {$(
        impl<L: Lanes> $Trait for Number<L> {
            type Output = Self;
            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                Self(self.0.$name(other.0))
            }
        }
        impl<L: Lanes> $Trait<f32> for Number<L> {
            type Output = Self;
            #[inline(always)]
            fn $name(self, other: f32) -> Self {
                Self(self.0.$name(L::splat(other)))
            }
        }
        impl<L: Lanes> $Assign for Number<L> {
            #[inline(always)]
            fn $assign(&mut self, other: Self) {
                *self = Self(self.0.$name(other.0));
            }
        }
    )*};
}

operators! {
    Add add AddAssign add_assign;
    Sub sub SubAssign sub_assign;
    Mul mul MulAssign mul_assign;
}

impl<L: Lanes> Div for Number<L> {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        Self(self.0.div(other.0))
    }
}

impl<L: Lanes> Neg for Number<L> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(self.0.neg())
    }
}

//! Which instruction set runs a kernel.

use std::sync::OnceLock;

use crate::Lanes;

/// The environment variable that limits [`Level::best`]: `portable`, `avx2` or `avx512`. Results are the same with
/// all, which this shows.
pub const INSTRUCTIONS: &str = "SWARMWRIGHT_INSTRUCTIONS";

/// Whether the library was compiled for processors that have no more than [`Level::Portable`], too (`SWARMWRIGHT_LEVELS`, see
/// `build.rs`): large kernels are left out for it where it was not.
pub const IS_FOR_PORTABLE: bool = cfg!(level_portable);

/// An instruction set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Level {
    /// What every processor of the architecture has (SSE2, NEON): 4 lanes.
    Portable,
    /// AVX2: 8 lanes.
    Avx2,
    /// AVX-512 F, BW, DQ, VL, and POPCNT: 16 lanes.
    Avx512,
}

/// Work that can be done with any number of lanes.
pub trait Kernel {
    /// What comes out.
    type Output;
    /// Does the work. Mark the implementation, and whatever it calls with `L`, `#[inline(always)]`, and use loops where
    /// you would use closures over lanes: only what is inlined into [`Level::run`] or [`Lanes::apart`] is compiled for
    /// the instruction set, and what is not is right but slow.
    fn run<L: Lanes>(self) -> Self::Output;
}

impl Level {
    /// The instruction sets of this processor that kernels were compiled for, the best one last. [`Portable`](Self::Portable) is always
    /// one of them.
    #[must_use]
    pub fn available() -> Vec<Self> {
        let all = [Self::Portable, Self::Avx2, Self::Avx512];
        all.into_iter().filter(|level| level.is_here()).collect()
    }

    /// The best instruction set of this processor, or that of the environment variable [`INSTRUCTIONS`].
    #[must_use]
    pub fn best() -> Self {
        static BEST: OnceLock<Level> = OnceLock::new();
        *BEST.get_or_init(|| {
            Self::asked_for()
                .ok()
                .flatten()
                .unwrap_or_else(Self::of_processor)
        })
    }

    /// The instruction set that the environment variable [`INSTRUCTIONS`] names, if it is set.
    ///
    /// # Errors
    /// What is wrong with it: this processor does not have the instruction set, or there is none of that name.
    pub fn asked_for() -> Result<Option<Self>, String> {
        let Some(value) = std::env::var_os(INSTRUCTIONS).filter(|value| !value.is_empty()) else {
            return Ok(None);
        };
        let available = Self::available();
        let level = available.iter().find(|level| value == level.name());
        level.copied().map(Some).ok_or_else(|| {
            let names: Vec<_> = available.iter().map(|level| level.name()).collect();
            format!(
                "{INSTRUCTIONS}={}: expected {}, the instruction sets of this processor that the library was compiled for",
                value.to_string_lossy(),
                names.join(" or ")
            )
        })
    }

    fn of_processor() -> Self {
        let best = [Self::Avx512, Self::Avx2];
        best.into_iter()
            .find(|level| level.is_here())
            .unwrap_or(Self::Portable)
    }

    /// Whether this processor has the instruction set, and kernels were compiled for it.
    fn is_here(self) -> bool {
        match self {
            Self::Portable => true,
            #[cfg(all(target_arch = "x86_64", level_avx2))]
            Self::Avx2 => is_x86_feature_detected!("avx2"),
            #[cfg(all(target_arch = "x86_64", level_avx512))]
            Self::Avx512 => {
                is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("popcnt")
            }
            #[expect(unreachable_patterns, reason = "where all of them are compiled")]
            Self::Avx2 | Self::Avx512 => false,
        }
    }

    /// Lanes of a vector.
    #[must_use]
    pub const fn width(self) -> usize {
        match self {
            Self::Portable => 4,
            Self::Avx2 => 8,
            Self::Avx512 => 16,
        }
    }

    /// The name: portable, avx2, avx512.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Portable => "portable",
            Self::Avx2 => "avx2",
            Self::Avx512 => "avx512",
        }
    }

    /// Runs a kernel. Panics when the processor lacks the instruction set.
    #[allow(unsafe_code)]
    pub fn run<K: Kernel>(self, kernel: K) -> K::Output {
        assert!(self.is_here(), "this processor has no {}", self.name());
        match self {
            #[cfg(all(target_arch = "x86_64", level_avx512))]
            // SAFETY: the processor has the features that the function enables, as asserted above.
            Self::Avx512 => unsafe {
                avx512(
                    #[inline(always)]
                    || kernel.run::<crate::x86::avx512::F32s>(),
                )
            },
            #[cfg(all(target_arch = "x86_64", level_avx2))]
            // SAFETY: as above.
            Self::Avx2 => unsafe {
                avx2(
                    #[inline(always)]
                    || kernel.run::<crate::x86::avx2::F32s>(),
                )
            },
            _ => kernel.run::<crate::portable::F32s>(),
        }
    }
}

/// Does work, whose closure is always inlined, in a function of its own that is compiled for AVX-512.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,popcnt")]
#[inline(never)]
pub fn avx512<T>(work: impl FnOnce() -> T) -> T {
    work()
}

/// The same for AVX2.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
#[inline(never)]
pub fn avx2<T>(work: impl FnOnce() -> T) -> T {
    work()
}

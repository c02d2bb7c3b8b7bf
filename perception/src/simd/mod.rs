//! Vectors of 32 bytes and the instruction-set levels that implement their operations.
//!
//! Kernels are written once, generic over [`Simd`], and compiled once for each level: plain Rust, NEON with and without
//! `dotprod`, AVX2, AVX-512. All levels do the same arithmetic on the same lanes, so their results are bit-identical.
//! [`Level::best`] selects the fastest level at run time.

#[cfg(target_arch = "x86_64")]
pub mod avx2;
#[cfg(target_arch = "x86_64")]
pub mod avx512;
mod kernel_set;
#[cfg(target_arch = "aarch64")]
pub mod neon;
pub mod plain;
pub mod rounding;

use std::sync::atomic::{AtomicUsize, Ordering};

pub use kernel_set::{CostConstants, CostRow, LANES, Lanes, Packing, RemapTile, Simd, Streaming};

/// The instruction-set level that kernels run on. A value exists only for a level that this machine supports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Level(pub(crate) Kind);

/// The levels that this build supports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Plain,
    #[cfg(target_arch = "aarch64")]
    Neon,
    #[cfg(target_arch = "aarch64")]
    Dotprod,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

/// Number of levels that [`Level::best`] chooses from, the slowest first.
static ALLOWED: AtomicUsize = AtomicUsize::new(usize::MAX);

impl Level {
    /// Plain Rust: the reference implementation. Every other level gives the same results.
    pub const PLAIN: Level = Level(Kind::Plain);

    /// The fastest level that this machine supports, or that [`Level::limit`] has left.
    pub fn best() -> Self {
        // Any order of threads will do: a process sets it once, before it starts others.
        let allowed = ALLOWED.load(Ordering::Relaxed);
        Self::available().into_iter().take(allowed).next_back().unwrap_or(Self::PLAIN)
    }

    /// Makes this the fastest level that [`Level::best`] gives from now on in this process, to
    /// reproduce a slower machine.
    pub fn limit(self) {
        let slower = Self::available().into_iter().take_while(|&level| level != self).count();
        ALLOWED.store(slower + 1, Ordering::Relaxed);
    }

    /// The level of a name, if this machine supports it.
    pub fn named(name: &str) -> Option<Self> {
        Self::available().into_iter().find(|level| level.name() == name)
    }

    /// All levels that this machine supports, the slowest first.
    pub fn available() -> Vec<Self> {
        #[allow(unused_mut)]
        let mut levels = vec![Self::PLAIN];
        #[cfg(target_arch = "aarch64")]
        {
            levels.push(Level(Kind::Neon));
            if std::arch::is_aarch64_feature_detected!("dotprod") {
                levels.push(Level(Kind::Dotprod));
            }
        }
        #[cfg(target_arch = "x86_64")]
        {
            let avx2 = is_x86_feature_detected!("avx2");
            if avx2 {
                levels.push(Level(Kind::Avx2));
            }
            let avx512 = is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512vl")
                && is_x86_feature_detected!("avx512vnni");
            if avx2 && avx512 {
                levels.push(Level(Kind::Avx512));
            }
        }
        levels
    }

    /// Name of the level: `plain`, `neon`, `dotprod`, `avx2` or `avx512`.
    pub fn name(self) -> &'static str {
        match self.0 {
            Kind::Plain => "plain",
            #[cfg(target_arch = "aarch64")]
            Kind::Neon => "neon",
            #[cfg(target_arch = "aarch64")]
            Kind::Dotprod => "dotprod",
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 => "avx2",
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 => "avx512",
        }
    }
}

/// Declares a kernel: a function that takes a [`Level`] and runs `generic` compiled for it.
macro_rules! kernel {
    ($(#[$doc:meta])* $vis:vis fn $name:ident($($arg:ident: $type:ty),* $(,)?) = $generic:path) => {
        $(#[$doc])*
        #[allow(clippy::too_many_arguments)]
        $vis fn $name(level: $crate::simd::Level, $($arg: $type),*) {
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2")]
            #[allow(clippy::too_many_arguments)]
            fn avx2($($arg: $type),*) {
                $generic($crate::simd::avx2::Avx2::new(), $($arg),*)
            }
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2,avx512f,avx512bw,avx512vl,avx512vnni")]
            #[allow(clippy::too_many_arguments)]
            fn avx512($($arg: $type),*) {
                $generic($crate::simd::avx512::Avx512::new(), $($arg),*)
            }
            #[cfg(target_arch = "aarch64")]
            #[target_feature(enable = "neon,dotprod")]
            #[allow(clippy::too_many_arguments)]
            fn dotprod($($arg: $type),*) {
                $generic($crate::simd::neon::Neon::<true>::new(), $($arg),*)
            }
            match level.0 {
                $crate::simd::Kind::Plain => $generic($crate::simd::plain::Plain, $($arg),*),
                #[cfg(target_arch = "aarch64")]
                $crate::simd::Kind::Neon => $generic($crate::simd::neon::Neon::<false>::new(), $($arg),*),
                // SAFETY: a `Level` of this kind is created only after the feature was detected.
                #[cfg(target_arch = "aarch64")]
                $crate::simd::Kind::Dotprod => unsafe { dotprod($($arg),*) },
                // SAFETY: a `Level` of this kind is created only after the feature was detected.
                #[cfg(target_arch = "x86_64")]
                $crate::simd::Kind::Avx2 => unsafe { avx2($($arg),*) },
                // SAFETY: a `Level` of this kind is created only after the features were detected.
                #[cfg(target_arch = "x86_64")]
                $crate::simd::Kind::Avx512 => unsafe { avx512($($arg),*) },
            }
        }
    };
}
pub(crate) use kernel;

#[cfg(test)]
mod tests;

//! Which instructions this processor has, as a value that can only be made by asking it.

use std::sync::LazyLock;

/// Instruction sets in the order of preference, worst first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Isa {
    Scalar,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
    #[cfg(target_arch = "aarch64")]
    Neon,
}

impl Isa {
    const ALL: &[Self] = &[
        Self::Scalar,
        #[cfg(target_arch = "x86_64")]
        Self::Avx2,
        #[cfg(target_arch = "x86_64")]
        Self::Avx512,
        #[cfg(target_arch = "aarch64")]
        Self::Neon,
    ];

    fn is_available(self) -> bool {
        match self {
            Self::Scalar => true,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => {
                is_x86_feature_detected!("avx2")
                    && is_x86_feature_detected!("popcnt")
                    && is_x86_feature_detected!("bmi1")
            }
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                Self::Avx2.is_available()
                    && is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("avx512vl")
            }
            #[cfg(target_arch = "aarch64")]
            Self::Neon => std::arch::is_aarch64_feature_detected!("neon"),
        }
    }
}

/// An instruction set that this processor has been seen to have.
///
/// There is no other way to obtain a level than detection, so holding one is the proof that makes its kernels safe
/// to call.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Level(Isa);

impl Level {
    /// No vector instructions beyond those every processor of the target has.
    pub const SCALAR: Self = Self(Isa::Scalar);

    /// AVX2 (with BMI1 and POPCNT), where the processor has it.
    #[cfg(target_arch = "x86_64")]
    pub fn avx2() -> Option<Self> {
        Isa::Avx2.is_available().then_some(Self(Isa::Avx2))
    }

    /// AVX-512 F, BW and VL, where the processor has them.
    #[cfg(target_arch = "x86_64")]
    pub fn avx512() -> Option<Self> {
        Isa::Avx512.is_available().then_some(Self(Isa::Avx512))
    }

    /// NEON, which every 64-bit Arm processor has in practice.
    #[cfg(target_arch = "aarch64")]
    pub fn neon() -> Option<Self> {
        Isa::Neon.is_available().then_some(Self(Isa::Neon))
    }

    /// Every level this processor has, [`SCALAR`](Self::SCALAR) first.
    pub fn available() -> impl Iterator<Item = Self> {
        Isa::ALL.iter().copied().filter(|isa| isa.is_available()).map(Self)
    }

    /// The best level this processor has.
    pub fn best() -> Self {
        Self::available().last().unwrap_or(Self::SCALAR)
    }

    /// The level in use, chosen once: the best one, or the lower one that `EPILINE_SIMD` names
    /// (`scalar`, `avx2`, `avx512`, `neon`).
    ///
    /// A name that is unknown, or of a level this processor lacks, changes nothing: the variable can slow the
    /// library down for a test but cannot break it.
    pub fn current() -> Self {
        static CURRENT: LazyLock<Level> = LazyLock::new(|| {
            let asked = std::env::var("EPILINE_SIMD").unwrap_or_default();
            Level::named(&asked).unwrap_or_else(Level::best)
        });
        *CURRENT
    }

    /// The level of that name, if this processor has it.
    pub fn named(name: &str) -> Option<Self> {
        Self::available().find(|level| level.name() == name)
    }

    /// The name `EPILINE_SIMD` knows it by.
    pub fn name(self) -> &'static str {
        match self.0 {
            Isa::Scalar => "scalar",
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => "avx2",
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => "avx512",
            #[cfg(target_arch = "aarch64")]
            Isa::Neon => "neon",
        }
    }
}

/// Name of the [level in use](Level::current).
pub fn simd_level() -> &'static str {
    Level::current().name()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_available_level_is_found_by_its_name_and_nothing_else_is() {
        for level in Level::available() {
            assert_eq!(Level::named(level.name()), Some(level));
        }
        assert_eq!(Level::named("mmx"), None);
        assert_eq!(Level::named(""), None);
    }

    #[test]
    fn scalar_is_always_there_and_the_best_is_the_highest() {
        let levels: Vec<Level> = Level::available().collect();
        assert_eq!(levels[0], Level::SCALAR);
        assert!(levels.is_sorted());
        assert_eq!(levels.last(), Some(&Level::best()));
    }
}

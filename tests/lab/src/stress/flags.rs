//! Floating-point flags of the threads that take part (caller, pool, writers of boxes): games and audio
//! programs set them, threads inherit them, and no answer may depend on them.

use std::fmt;

use pairmask_core::floats;
use pairmaskd::scene::Random;
use rayon::ThreadPool;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Rounding {
    /// To the nearest, ties to even: the default. In the order of x86-64's register.
    #[default]
    Nearest,
    /// Towards −∞.
    Down,
    /// Towards +∞.
    Up,
    /// Towards 0.
    TowardZero,
}

impl Rounding {
    pub const ALL: [Self; 4] = [Self::Nearest, Self::Down, Self::Up, Self::TowardZero];
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FloatFlags {
    pub rounding: Rounding,
    /// Results that are subnormal become zero (FTZ).
    pub flush_to_zero: bool,
    /// Operands that are subnormal count as zero (DAZ). On aarch64 one flag does both.
    pub denormals_are_zero: bool,
}

impl FloatFlags {
    /// The flags that threads start with, and that Rust assumes.
    pub const DEFAULT: Self =
        Self { rounding: Rounding::Nearest, flush_to_zero: false, denormals_are_zero: false };

    /// The flags that games and audio programs set.
    pub const FLUSHING: Self =
        Self { rounding: Rounding::Nearest, flush_to_zero: true, denormals_are_zero: true };

    /// All sixteen, the default first.
    pub fn all() -> impl Iterator<Item = Self> {
        (0..16usize).map(|i| Self {
            rounding: Rounding::ALL[i / 4],
            flush_to_zero: i & 1 != 0,
            denormals_are_zero: i & 2 != 0,
        })
    }

    pub const fn rounding(rounding: Rounding) -> Self {
        Self { rounding, ..Self::DEFAULT }
    }

    #[cfg(target_arch = "x86_64")]
    fn control(self) -> floats::Control {
        let (ftz, daz) = (u32::from(self.flush_to_zero), u32::from(self.denormals_are_zero));
        floats::DEFAULT | (self.rounding as u32) << 13 | ftz << 15 | daz << 6
    }

    #[cfg(target_arch = "aarch64")]
    fn control(self) -> floats::Control {
        let rounding = [0, 2, 1, 3][self.rounding as usize];
        u64::from(self.flush_to_zero || self.denormals_are_zero) << 24 | rounding << 22
    }

    /// Other processors: this program knows no flags of theirs.
    #[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
    fn control(self) -> floats::Control {
        floats::DEFAULT
    }

    /// Runs `work` with these flags ([`floats::with`]), and puts this thread's back.
    pub fn run<R>(self, work: impl FnOnce() -> R) -> R {
        floats::with(self.control(), work)
    }
}

impl fmt::Display for FloatFlags {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.rounding {
            Rounding::Nearest => "nearest",
            Rounding::Down => "down",
            Rounding::Up => "up",
            Rounding::TowardZero => "toward zero",
        })?;
        let flags = [(self.flush_to_zero, " ftz"), (self.denormals_are_zero, " daz")];
        flags.iter().filter(|(is_set, _)| *is_set).try_for_each(|(_, name)| f.write_str(name))
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MixedFlags {
    pub caller: FloatFlags,
    /// The pool's threads, in turn.
    pub pool: [FloatFlags; 2],
    /// The threads that write the boxes of a frame, in turn.
    pub writers: [FloatFlags; 3],
}

/// Makes the random numbers of flags independent of those of boxes.
const STREAM: u64 = 0x464c_4147_5300;

impl MixedFlags {
    pub fn of_seed(seed: u64) -> Self {
        let mut random = Random::new(seed ^ STREAM);
        // The default ones one time in four.
        let mut draw = || FloatFlags::all().nth(random.below(20) as usize).unwrap_or_default();
        Self {
            caller: draw(),
            pool: std::array::from_fn(|_| draw()),
            writers: std::array::from_fn(|_| draw()),
        }
    }

    /// The pool's threads keep their flags.
    pub fn install<R: Send>(&self, pool: &ThreadPool, work: impl FnOnce() -> R + Send) -> R {
        pool.broadcast(|thread| floats::set(self.pool[thread.index() % self.pool.len()].control()));
        pool.install(|| self.caller.run(work))
    }

    /// The results of `write` for 0 to n − 1, computed by the writers in turn.
    pub fn written<T>(&self, n: usize, write: impl Fn(usize) -> T) -> Vec<T> {
        let writer = |i: usize| self.writers[i % self.writers.len()];
        (0..n).map(|i| writer(i).run(|| write(i))).collect()
    }
}

impl fmt::Display for MixedFlags {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { caller, pool: [first, second], writers: [a, b, c] } = self;
        write!(f, "caller {caller}; pool {first}, {second}; writers {a}, {b}, {c}")
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::hint::black_box;

    use super::*;

    #[test]
    fn flags_change_results_and_are_put_back() {
        let third = || (black_box(1.0f32) / black_box(3.0)).to_bits();
        let minus_third = || (black_box(-1.0f32) / black_box(3.0)).to_bits();
        let tiny = || (black_box(f32::MIN_POSITIVE) * black_box(0.5)).to_bits();
        let summed = || (black_box(1e-40f32) + black_box(f32::MIN_POSITIVE)).to_bits();
        let all = || [third(), minus_third(), tiny(), summed()];
        let default = all();
        let kinds: BTreeSet<[u32; 4]> = FloatFlags::all().map(|flags| flags.run(all)).collect();
        // On aarch64 one flag flushes operands and results.
        assert_eq!(kinds.len(), if cfg!(target_arch = "aarch64") { 8 } else { 16 });
        assert_eq!(FloatFlags::DEFAULT.run(all), default);
        assert_eq!(all(), default);
        assert_eq!(FloatFlags::rounding(Rounding::Down).run(third), default[0] - 1);
        assert_eq!(FloatFlags::FLUSHING.run(tiny), 0);
        // Pool and caller have flags of their own.
        let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("threads");
        let flags = MixedFlags {
            caller: FloatFlags::rounding(Rounding::Up),
            pool: [FloatFlags::rounding(Rounding::Down), FloatFlags::DEFAULT],
            ..MixedFlags::default()
        };
        assert_eq!(flags.install(&pool, third), 0x3eaa_aaab);
        let pool_thirds = pool.broadcast(|_| third());
        assert_eq!(pool_thirds, [0x3eaa_aaaa, 0x3eaa_aaab]);
        let drawn: BTreeSet<String> =
            (0..200).map(|seed| MixedFlags::of_seed(seed).to_string()).collect();
        assert!(drawn.len() > 190);
    }
}

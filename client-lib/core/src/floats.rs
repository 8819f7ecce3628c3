//! Floating-point flags of threads. Only this module reads and sets them.
//!
//! Every thread has a rounding mode and flags that make subnormals zero (MXCSR on x86-64, FPCR on
//! aarch64). Games and audio programs set them, and a thread inherits those of the thread that starts
//! it. So a caller's thread, the threads of its rayon pool and the writers of one frame may all
//! compute differently: a coordinate then lies in one cell for one thread and in another cell for
//! the next, and pairs are lost between the two.
//!
//! Integers have no flags, and coordinates are compared as integer keys wherever they are only
//! compared. What has to be computed in floats is computed within [`with_default`]: rounding to
//! nearest, subnormals as they are. Rust assumes these flags everywhere, so only there does float
//! arithmetic mean what the source says.
//!
//! # Rules
//!
//! * Work of several threads goes through [`in_parts`](crate::engine) or a loop of rayon whose body is
//!   a call of [`with_default`]: a task inherits nothing from who handed it out.
//! * A call of [`with_default`] holds no `join`: a rayon thread that waits runs foreign tasks, which
//!   expect the thread's own flags and may change them.
//! * Float code that relies on it says so by `debug_assert!(floats::are_default())`.
//!
//! Where the flags are the default ones, which is nearly always, [`with_default`] reads one
//! register.

use std::hint::black_box;

#[doc(hidden)]
pub use self::register::{Control, DEFAULT, write as set};

/// A sum as it is rounded, and what rounding has left out (Knuth). Needs the default flags.
#[inline(always)]
pub(crate) fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let of_b = sum - a;
    (sum, (a - (sum - of_b)) + (b - of_b))
}

#[cfg(all(target_arch = "x86_64", not(miri)))]
#[allow(unsafe_code)]
mod register {
    use std::arch::asm;

    /// All exceptions masked, rounding to nearest, subnormals as they are.
    pub const DEFAULT: Control = 0x1f80;
    /// Flags that say which exceptions have occurred: they do not change any result.
    const OCCURRED: Control = 0x3f;
    /// Bits that must be zero.
    const RESERVED: Control = 0xffff_0000;

    /// The register's content.
    pub type Control = u32;

    #[inline(always)]
    pub fn read() -> Control {
        let mut control: Control = 0;
        // SAFETY: writes four bytes to a place of four bytes, and nothing else.
        unsafe {
            asm!("stmxcsr [{}]", in(reg) &raw mut control, options(nostack, preserves_flags));
        };
        control
    }

    #[inline(always)]
    pub fn is_default(control: Control) -> bool {
        control & !OCCURRED == DEFAULT
    }

    /// Sets this thread's flags.
    pub fn write(control: Control) {
        let control = control & !RESERVED;
        // SAFETY: reads four bytes, whose reserved bits are zero. This function is called around code
        // that is to run with other flags, and before and after it.
        unsafe { asm!("ldmxcsr [{}]", in(reg) &raw const control, options(nostack)) };
    }
}

#[cfg(all(target_arch = "aarch64", not(miri)))]
#[allow(unsafe_code)]
mod register {
    use std::arch::asm;

    /// Exceptions do not trap, rounding to nearest, subnormals as they are.
    pub const DEFAULT: Control = 0;

    /// The register's content.
    pub type Control = u64;

    #[inline(always)]
    pub fn read() -> Control {
        let control: Control;
        // SAFETY: reads a register that every thread may read.
        unsafe { asm!("mrs {}, fpcr", out(reg) control, options(nostack, preserves_flags)) };
        control
    }

    #[inline(always)]
    pub fn is_default(control: Control) -> bool {
        control == DEFAULT
    }

    /// Sets this thread's flags.
    pub fn write(control: Control) {
        // SAFETY: a register that every thread may write, and whose reserved bits are ignored. This
        // function is called around code that is to run with other flags, and before and after it.
        unsafe { asm!("msr fpcr, {}", in(reg) control, options(nostack)) };
    }
}

/// Other processors, and Miri, which runs no assembly: threads are assumed to have the default flags.
#[cfg(any(miri, not(any(target_arch = "x86_64", target_arch = "aarch64"))))]
mod register {
    pub const DEFAULT: Control = ();
    /// Nothing is known of it.
    pub type Control = ();
    pub fn read() {}
    pub fn is_default((): Control) -> bool {
        true
    }
    pub fn write((): Control) {}
}

/// Whether this thread rounds to nearest and keeps subnormals.
#[inline]
pub fn are_default() -> bool {
    register::is_default(register::read())
}

/// Runs `work` with the default flags and puts this thread's own back, also after a panic.
///
/// `work` must not wait for other tasks of a rayon pool: see the rules at the head of this module.
#[inline(always)]
pub fn with_default<R>(work: impl FnOnce() -> R) -> R {
    let given = register::read();
    if register::is_default(given) { work() } else { with_in_place_of(given, DEFAULT, work) }
}

/// Runs `work` with these flags, as on a host program's thread, and puts this thread's flags back: for tests.
///
/// Rust assumes the default flags: results of float arithmetic in `work` itself, outside of functions that set their
/// own flags, are not defined.
#[doc(hidden)]
pub fn with<R>(control: Control, work: impl FnOnce() -> R) -> R {
    with_in_place_of(register::read(), control, work)
}

/// Puts the flags back when dropped.
struct Restore(Control);

impl Drop for Restore {
    fn drop(&mut self) {
        register::write(self.0);
    }
}

/// The rare case of a change of flags, out of line.
///
/// The compiler treats float arithmetic as independent of the register, and could move it across the
/// instruction that writes it. The work therefore runs in a function that is not inlined. Its input
/// and output pass through `black_box`, which the compiler must assume to change them, so that the
/// call can neither begin before the flags are set nor end after they are put back.
#[cold]
#[inline(never)]
fn with_in_place_of<R>(given: Control, control: Control, work: impl FnOnce() -> R) -> R {
    let _restore = Restore(given);
    register::write(control);
    black_box(apart(black_box(work)))
}

#[inline(never)]
fn apart<R>(work: impl FnOnce() -> R) -> R {
    work()
}

#[cfg(all(test, not(miri), any(target_arch = "x86_64", target_arch = "aarch64")))]
mod tests {
    use super::*;

    #[cfg(target_arch = "x86_64")]
    const DOWNWARD_FLUSHED: register::Control = 0x1f80 | 1 << 13 | 1 << 15 | 1 << 6;
    #[cfg(target_arch = "aarch64")]
    const DOWNWARD_FLUSHED: register::Control = 1 << 24 | 2 << 22;

    /// Runs `work` on a new thread with other flags, so that no other test's thread has them.
    fn on_a_flagged_thread<R: Send>(work: impl FnOnce() -> R + Send) -> R {
        std::thread::scope(|scope| {
            let flagged = move || {
                let _restore = Restore(register::read());
                register::write(DOWNWARD_FLUSHED);
                black_box(apart(black_box(work)))
            };
            scope.spawn(flagged).join().expect("no panic")
        })
    }

    fn third() -> u32 {
        (black_box(1.0f32) / black_box(3.0)).to_bits()
    }

    fn half_of_least_normal() -> u32 {
        (black_box(f32::MIN_POSITIVE) * black_box(0.5)).to_bits()
    }

    #[test]
    fn work_has_the_default_flags_and_the_thread_its_own_again() {
        let (before, within, after) = on_a_flagged_thread(|| {
            let all = || (third(), half_of_least_normal(), are_default());
            (all(), with_default(all), all())
        });
        assert_eq!(before, (0x3eaa_aaaa, 0, false), "the test sets flags");
        assert_eq!(within, (0x3eaa_aaab, 0x0040_0000, true));
        assert_eq!(after, before);
    }

    #[test]
    fn a_panic_puts_the_flags_back() {
        let after = on_a_flagged_thread(|| {
            let panic = || with_default(|| std::panic::panic_any("on purpose"));
            assert!(std::panic::catch_unwind(panic).is_err());
            (third(), are_default())
        });
        assert_eq!(after, (0x3eaa_aaaa, false));
    }

    #[test]
    fn pure_work_is_not_moved_out() {
        // Only numbers go in and out: the compiler is as free to move the work as it can be.
        let (x, y) = (black_box(1.0f32), black_box(3.0f32));
        let (flagged, default) = on_a_flagged_thread(move || (x / y, with_default(|| x / y)));
        assert_eq!((flagged.to_bits(), default.to_bits()), (0x3eaa_aaaa, 0x3eaa_aaab));
    }

    #[test]
    fn calls_within_calls_change_nothing() {
        assert_eq!(with_default(|| with_default(third)), 0x3eaa_aaab);
        let nested = on_a_flagged_thread(|| with_default(|| (with_default(third), third())));
        assert_eq!(nested, (0x3eaa_aaab, 0x3eaa_aaab));
    }
}

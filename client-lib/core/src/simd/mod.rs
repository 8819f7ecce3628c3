//! Registers of keys: what comparisons, ingest and the search for words need of an instruction set.
//!
//! Loops are written once, generic over [`Simd`], and [`per_isa!`] compiles them for each instruction
//! set and calls the one that the machine has, as memchr does with its trait `Vector`. A value of a type
//! that implements [`Simd`] is the proof that the processor has the instructions, so that all methods
//! but those that read by address are safe. Generic functions are
//! `#[inline(always)]`, and build arrays of registers by loops: what they call otherwise, `map` of an
//! array too, is not compiled for the instruction set.

#[cfg(target_arch = "x86_64")]
pub(crate) mod avx2;
#[cfg(target_arch = "x86_64")]
pub(crate) mod avx512;
pub(crate) mod portable;

use crate::aabb::Aabb;

pub(crate) const MOST_LANES: usize = 16;

/// An instruction set that the processor has.
pub(crate) trait Simd: Copy {
    type Keys: Copy;
    type Lanes: Copy;
    /// The lanes whose intervals met on every axis so far.
    type Met: Copy;

    /// Keys of a register. It divides [`MOST_LANES`].
    const LANES: usize;

    /// A key in every lane.
    fn splat(self, key: i32) -> Self::Keys;

    /// The keys from an address on.
    ///
    /// # Safety
    /// As many keys as there are lanes must lie there.
    #[allow(unsafe_code)]
    unsafe fn load_from(self, keys: *const i32) -> Self::Keys;

    /// Writes the keys to an address.
    ///
    /// # Safety
    /// As many keys as there are lanes must lie there, and be the caller's to write.
    #[allow(unsafe_code)]
    unsafe fn store_to(self, keys: Self::Keys, to: *mut i32);

    /// The first keys of a slice, which must have as many.
    #[allow(unsafe_code)]
    #[inline(always)]
    fn load(self, keys: &[i32]) -> Self::Keys {
        assert!(keys.len() >= Self::LANES);
        // SAFETY: the slice has as many keys as there are lanes.
        unsafe { self.load_from(keys.as_ptr()) }
    }

    /// Writes the first keys of a slice, which must have as many.
    #[allow(unsafe_code)]
    #[inline(always)]
    fn store(self, keys: Self::Keys, to: &mut [i32]) {
        assert!(to.len() >= Self::LANES);
        // SAFETY: the slice has as many keys as there are lanes, and is exclusively borrowed.
        unsafe { self.store_to(keys, to.as_mut_ptr()) }
    }

    /// All lanes, before the first axis.
    fn all_meet(self) -> Self::Met;

    /// Those of `met` whose intervals meet, where none of a row's and none of the columns' intervals has
    /// its min above its max but those that meet nothing.
    fn meet(self, met: Self::Met, columns: [Self::Keys; 2], row: [Self::Keys; 2]) -> Self::Met;

    /// Bit i: lane i met.
    fn met_bits(self, met: Self::Met) -> u32;

    /// The lanes in which `a` is above `b`.
    fn above(self, a: Self::Keys, b: Self::Keys) -> Self::Lanes;

    /// The lanes in which `a` is `b`.
    fn equal(self, a: Self::Keys, b: Self::Keys) -> Self::Lanes;

    /// The lanes in which one of two f32, given as their bits, is a NaN. No mode of the processor
    /// changes the answer.
    fn unordered(self, a: Self::Keys, b: Self::Keys) -> Self::Lanes;

    fn either(self, a: Self::Lanes, b: Self::Lanes) -> Self::Lanes;

    /// Bit i: lane i is one of them.
    fn bits(self, lanes: Self::Lanes) -> u32;

    /// `chosen` in the lanes, `others` in all others.
    fn select(self, lanes: Self::Lanes, chosen: Self::Keys, others: Self::Keys) -> Self::Keys;

    /// [`order_key`](crate::aabb::order_key) of the bits of f32.
    fn order_keys(self, bits: Self::Keys) -> Self::Keys;

    /// The coordinates of boxes, of which there must be as many as lanes: one register each, in wire order.
    fn coordinates(self, boxes: &[Aabb]) -> [Self::Keys; 6];

    /// Word k of records in register k. There must be as many records as lanes.
    fn words_of<'a>(self, record: impl Fn(usize) -> &'a [i32; 8]) -> [Self::Keys; 8];
}

/// What searches need to put lanes side by side. Without such instructions, one lane after the other is sooner
/// done.
pub(crate) trait Squeeze: Simd {
    /// `a`, and in the lanes that are of both kinds the bits of `b` too.
    fn or_where(self, lanes: [Self::Lanes; 2], a: Self::Keys, b: Self::Keys) -> Self::Keys;

    /// The first numbers of a slice, which must have as many as lanes.
    fn widen(self, numbers: &[u16]) -> Self::Keys;

    /// The lanes of `set` at the front of each register, in their order. What is behind them is unspecified.
    fn squeeze(self, set: u32, registers: [Self::Keys; 3]) -> [Self::Keys; 3];

    /// Every lane one place further, behind `first`.
    fn behind(self, keys: Self::Keys, first: u32) -> Self::Keys;

    /// The words of the strips in the first half of the lanes: the row, column block and bits of two for each. A
    /// strip lies in one word or two: the bits of the second one are shifted out of the first.
    fn strip_words(self, row: Self::Keys, start: Self::Keys, bits: Self::Keys) -> [Self::Keys; 3];
}

/// Declares a function that is compiled for each instruction set. It takes the one to use as a further,
/// last argument; the body sees it as a [`Simd`], whose name and type are given first. Before a function that needs
/// more stand the trait of what it needs, and the body for machines without it.
macro_rules! per_isa {
    (
        $(#[$attribute:meta])*
        $visible:vis fn $name:ident<$simd:ident: $S:ident $(, $generic:ident: $bound:path)*>(
            $($argument:ident: $type:ty),* $(,)?
        ) $(-> $output:ty)? $body:block
    ) => {
        $crate::simd::per_isa! {
            Simd, { body($crate::simd::portable::Portable, $($argument),*) }
            $(#[$attribute])*
            $visible fn $name<$simd: $S $(, $generic: $bound)*>($($argument: $type),*)
            $(-> $output)? $body
        }
    };
    (
        $kind:ident, $plain:block
        $(#[$attribute:meta])*
        $visible:vis fn $name:ident<$simd:ident: $S:ident $(, $generic:ident: $bound:path)*>(
            $($argument:ident: $type:ty),* $(,)?
        ) $(-> $output:ty)? $body:block
    ) => {
        $(#[$attribute])*
        #[allow(unsafe_code)]
        #[inline]
        $visible fn $name<$($generic: $bound),*>(
            $($argument: $type,)* isa: $crate::isa::AvailableIsa
        ) $(-> $output)? {
            // Other processors have the portable function alone.
            #[cfg_attr(not(target_arch = "x86_64"), allow(dead_code))]
            #[inline(always)]
            fn body<$S: $crate::simd::$kind $(, $generic: $bound)*>(
                $simd: S, $($argument: $type),*
            ) $(-> $output)? $body

            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,popcnt,bmi1,bmi2")]
            fn avx512<$($generic: $bound),*>(
                simd: $crate::simd::avx512::Avx512, $($argument: $type),*
            ) $(-> $output)? {
                body(simd, $($argument),*)
            }

            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2,popcnt,bmi1,bmi2")]
            fn avx2<$($generic: $bound),*>(
                simd: $crate::simd::avx2::Avx2, $($argument: $type),*
            ) $(-> $output)? {
                body(simd, $($argument),*)
            }

            // A function of its own, so that what it has on the stack is not on that of the others.
            #[inline(never)]
            fn portable<$($generic: $bound),*>($($argument: $type),*) $(-> $output)? $plain

            match isa.get() {
                #[cfg(target_arch = "x86_64")]
                // SAFETY: an `AvailableIsa` of AVX-512 exists only where the CPU reported these features.
                $crate::isa::Isa::Avx512 => unsafe {
                    avx512($crate::simd::avx512::Avx512::new(), $($argument),*)
                },
                #[cfg(target_arch = "x86_64")]
                // SAFETY: an `AvailableIsa` of AVX2 exists only where the CPU reported these features.
                $crate::isa::Isa::Avx2 => unsafe {
                    avx2($crate::simd::avx2::Avx2::new(), $($argument),*)
                },
                _ => portable($($argument),*),
            }
        }
    };
}
pub(crate) use per_isa;

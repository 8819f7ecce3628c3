//! libFuzzer drives [`replies`](pairmask_fuzz::replies).
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| pairmask_fuzz::replies::decode(data));

//! libFuzzer drives [`recordings`](pairmask_fuzz::recordings).
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| pairmask_fuzz::recordings::decode(data));

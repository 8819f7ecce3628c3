//! libFuzzer drives [`questions`](pairmask_fuzz::questions).
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| pairmask_fuzz::questions::decode(data));

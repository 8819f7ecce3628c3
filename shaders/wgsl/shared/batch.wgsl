// What is known of each batch of BATCH_BOXES consecutive boxes. Mirrors: `layouts.rs`.

// Kept in video memory: summed by the pairs stage, read by the stage that writes the mask.
struct BatchTotals {
    // Non-zero mask words of the batch's rows.
    words: u32,
    // Overlapping pairs of the batch's rows. At most BATCH_BOXES * n, which fits for every n allowed.
    pairs: u32,
}

// Written to host memory once a frame; the host adds the batches up in 64 bits.
struct BatchReport {
    // Bit i: box i of the batch has a NaN.
    invalid: array<u32, BATCH_WORDS>,
    // Boxes with min > max on some axis.
    empty: u32,
    words: u32,
    pairs: u32,
    padding: u32,
}

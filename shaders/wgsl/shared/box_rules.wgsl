// The rules of a frame, in a block of words, `rules`: for each kind of box a bit for each kind that it
// meets; then for each box its owner, and its mark: kind, whether a list names it, and the rank of its
// world among those of the frame. Mirror: `pairmask_core::dispatch::Marks`.

const KIND_MASK: u32 = MARKED_KINDS - 1u;
const KIND_WORDS: u32 = MARKED_KINDS / 32u;
const LISTED: u32 = MARKED_KINDS;
const FIRST_BOX: u32 = MARKED_KINDS * KIND_WORDS;

fn owner_of(index: u32) -> u32 {
    return rules[FIRST_BOX + 2u * index];
}

fn mark_of(index: u32) -> u32 {
    return rules[FIRST_BOX + 2u * index + 1u];
}

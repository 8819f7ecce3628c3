/* Culls frames from the standard input: two numbers, how many boxes, and how often their frame is culled again and
 * timed; and so many boxes. It answers with five numbers, pairs, empty boxes, invalid ones, what served, and the
 * nanoseconds of the timed frames; and with the pairs. */
#define _POSIX_C_SOURCE 199309L

#include "check.h"

#include <time.h>

static void append(void *user, const pm_pair *pairs, size_t count) {
  pm_pair **end = user;
  memcpy(*end, pairs, count * sizeof *pairs);
  *end += count;
}

static pm_mask culled(pm_session session, const pm_box *given, uint32_t n) {
  pm_frame frame;
  pm_pending pending;
  pm_mask mask;
  pm_box *boxes;
  EXPECT(PM_OK, pm_session_frame(session, n, &frame, &boxes));
  memcpy(boxes, given, n * sizeof *given);
  EXPECT(PM_OK, pm_frame_submit(frame, NULL, &pending));
  EXPECT(PM_OK, pm_pending_wait(pending, &mask));
  return mask;
}

static uint64_t now(void) {
  struct timespec time;
  CHECK(clock_gettime(CLOCK_MONOTONIC, &time) == 0);
  return (uint64_t)time.tv_sec * 1000000000 + (uint64_t)time.tv_nsec;
}

int main(int argc, char **argv) {
  const pm_session_options options = options_of(argc, argv);
  pm_session session;
  uint32_t given[2];
  EXPECT(PM_OK, pm_session_connect(&options, &session));
  while (fread(given, sizeof given, 1, stdin) == 1) {
    const uint32_t n = given[0], times = given[1];
    pm_box *boxes = malloc((n + 1) * sizeof *boxes);
    CHECK(boxes != NULL && fread(boxes, sizeof *boxes, n, stdin) == n);

    pm_mask mask = culled(session, boxes, n);
    pm_frame_info info = {SIZED(pm_frame_info)};
    EXPECT(PM_OK, pm_mask_info(mask, &info));
    CHECK(info.n == n);
    pm_pair *copy = malloc((info.pair_count + 1) * sizeof *copy), *end = copy;
    CHECK(copy != NULL);
    EXPECT(PM_OK, pm_mask_for_each(mask, append, &end));
    const pm_pair *pairs;
    size_t count;
    EXPECT(PM_OK, pm_mask_pairs(mask, &pairs, &count));
    CHECK(count == info.pair_count && (size_t)(end - copy) == count);
    CHECK(count == 0 || memcmp(pairs, copy, count * sizeof *pairs) == 0);
    EXPECT(PM_OK, pm_mask_drop(mask));

    const uint64_t start = now();
    for (uint32_t i = 0; i < times; i++) {
      mask = culled(session, boxes, n);
      end = copy;
      EXPECT(PM_OK, pm_mask_for_each(mask, append, &end));
      EXPECT(PM_OK, pm_mask_drop(mask));
    }
    const uint64_t head[] = {count, info.empty, info.invalid, info.served_by, now() - start};
    CHECK(fwrite(head, sizeof head, 1, stdout) == 1);
    CHECK(fwrite(copy, sizeof *copy, count, stdout) == count);
    CHECK(fflush(stdout) == 0);
    free(copy);
    free(boxes);
  }
  EXPECT(PM_OK, pm_session_drop(session));
  return 0;
}

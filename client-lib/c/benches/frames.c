/* Times frames in process: for each number of frames on the standard input it culls so many, and prints the
 * nanoseconds of one. Arguments: a file of boxes. */
#include "pairmask.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

static void must(pm_code code) {
  if (code != PM_OK) {
    fprintf(stderr, "%s\n", pm_last_error());
    exit(1);
  }
}

static void add(void *user, const pm_pair *pairs, size_t count) {
  uint64_t *sum = user;
  size_t i;
  for (i = 0; i < count; i++) {
    *sum += pairs[i].a ^ pairs[i].b;
  }
}

int main(int argc, char **argv) {
  static pm_box given[1000];
  const pm_session_options options = {.struct_size = sizeof options,
                                      .backend = PM_BACKEND_IN_PROCESS,
                                      .no_repeats = 1,
                                      .threads = 1};
  pm_session session;
  unsigned long frames;
  FILE *file = argc == 2 ? fopen(argv[1], "rb") : NULL;

  if (file == NULL || fread(given, sizeof *given, 1000, file) != 1000) {
    return 2;
  }
  must(pm_session_connect(&options, &session));
  while (scanf("%lu", &frames) == 1) {
    struct timespec start, end;
    uint64_t sum = 0;
    unsigned long i;
    clock_gettime(CLOCK_MONOTONIC, &start);
    for (i = 0; i < frames; i++) {
      pm_frame frame;
      pm_pending pending;
      pm_mask mask;
      pm_box *boxes;
      must(pm_session_frame(session, 1000, &frame, &boxes));
      memcpy(boxes, given, sizeof given);
      must(pm_frame_submit(frame, NULL, &pending));
      must(pm_pending_wait(pending, &mask));
      must(pm_mask_for_each(mask, add, &sum));
      must(pm_mask_drop(mask));
    }
    clock_gettime(CLOCK_MONOTONIC, &end);
    printf("%.1f %llu\n",
           ((double)(end.tv_sec - start.tv_sec) * 1e9 + (double)(end.tv_nsec - start.tv_nsec)) / (double)frames,
           (unsigned long long)(sum / frames));
    fflush(stdout);
  }
  return 0;
}

/* What the test programs share: a check that ends the program, and the session that the arguments name. */
#ifndef CHECK_H
#define CHECK_H

#include "pairmask.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define CHECK(condition)                                                                           \
  do {                                                                                             \
    if (!(condition)) {                                                                            \
      fprintf(stderr, "%s:%d: %s; last error: %s\n", __FILE__, __LINE__, #condition,               \
              pm_last_error());                                                                    \
      exit(1);                                                                                     \
    }                                                                                              \
  } while (0)

/* That a call returns a code, and a text with it unless the code is PM_OK. */
#define EXPECT(code, call)                                                                         \
  do {                                                                                             \
    const pm_code expect_got = (call);                                                             \
    if (expect_got != (code)) {                                                                    \
      fprintf(stderr, "%s:%d: %s is %d, not %s: %s\n", __FILE__, __LINE__, #call, expect_got,      \
              #code, pm_last_error());                                                             \
      exit(1);                                                                                     \
    }                                                                                              \
    if (expect_got != PM_OK) {                                                                     \
      CHECK(pm_last_error()[0] != 0);                                                              \
    }                                                                                              \
  } while (0)

/* The first field of a struct that may grow. */
#define SIZED(type) .struct_size = sizeof(type)

/* Arguments: a backend by name, the runtime directory, an encoding or "auto"; and "timed" for one thread that culls
 * each frame anew. */
static inline pm_session_options options_of(int argc, char **argv) {
  static const char *const backends[] = {"auto", "daemon", "in-process"};
  pm_session_options options;
  memset(&options, 0, sizeof options);
  options.struct_size = sizeof options;
  CHECK(argc == 4 || (argc == 5 && strcmp(argv[4], "timed") == 0));
  while (strcmp(argv[1], backends[options.backend]) != 0) {
    options.backend++;
    CHECK(options.backend <= PM_BACKEND_IN_PROCESS);
  }
  options.runtime_dir = argv[2];
  options.encoding = strcmp(argv[3], "auto") == 0 ? NULL : argv[3];
  options.threads = options.no_repeats = argc == 5;
  return options;
}

#endif

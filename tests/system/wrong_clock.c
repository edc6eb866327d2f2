// The wall clock of a process as its operating system would have it after it was set: ahead of the true one by the
// seconds in the file CLOCKS/PID, else in CLOCKS/all, at any time. To be preloaded (LD_PRELOAD).
//
// All other clocks are right. Waits until a wall clock time end by the wrong clock, as after a real step: omniORB's do.
// libfaketime 0.9.10 would do the same, but time.sleep of Python 3.11 fails with it (EINVAL).

#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#define SECOND 1000000000LL
static const int64_t READ_INTERVAL = 5000000, WAIT_INTERVAL = 20000000;  // [ns]

static int64_t true_time(clockid_t clock) {
    struct timespec now;
    syscall(SYS_clock_gettime, clock, &now);
    return now.tv_sec * SECOND + now.tv_nsec;
}

static int read_ahead(const char *folder, const char *name, int64_t *ahead) {
    char path[4096], text[64];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    int file = open(path, O_RDONLY | O_CLOEXEC);
    if (file < 0) return 0;
    ssize_t size = read(file, text, sizeof text - 1);
    close(file);
    if (size <= 0) return 0;
    text[size] = 0;
    *ahead = (int64_t)(strtod(text, NULL) * SECOND);
    return 1;
}

// Nanoseconds by which the clock is ahead.
static int64_t ahead(void) {
    static _Atomic int64_t known, read_at, read_by;
    const char *folder = getenv("CLOCKS");
    int64_t now = true_time(CLOCK_MONOTONIC), pid = getpid();
    if (folder && (pid != read_by || now - read_at >= READ_INTERVAL)) {
        int error = errno;
        char own[24];
        int64_t found = 0;
        snprintf(own, sizeof own, "%lld", (long long)pid);
        if (!read_ahead(folder, own, &found)) read_ahead(folder, "all", &found);
        known = found;
        read_at = now;
        read_by = pid;
        errno = error;
    }
    return known;
}

static int64_t wrong_time(void) { return true_time(CLOCK_REALTIME) + ahead(); }

int clock_gettime(clockid_t clock, struct timespec *time) {
    if (syscall(SYS_clock_gettime, clock, time)) return -1;
    if (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE) {
        int64_t wrong = time->tv_sec * SECOND + time->tv_nsec + ahead();
        *time = (struct timespec){wrong / SECOND, wrong % SECOND};
    }
    return 0;
}

int gettimeofday(struct timeval *time, void *zone) {
    (void)zone;
    int64_t wrong = wrong_time();
    *time = (struct timeval){wrong / SECOND, wrong % SECOND / 1000};
    return 0;
}

time_t time(time_t *time) {
    time_t wrong = wrong_time() / SECOND;
    if (time) *time = wrong;
    return wrong;
}

int pthread_cond_timedwait(pthread_cond_t *condition, pthread_mutex_t *mutex, const struct timespec *until) {
    if (condition->__data.__wrefs & 2)  // glibc: its clock is the monotonic one
        return pthread_cond_clockwait(condition, mutex, CLOCK_MONOTONIC, until);
    for (;;) {
        int64_t left = until->tv_sec * SECOND + until->tv_nsec - wrong_time();
        if (left <= 0) return ETIMEDOUT;
        int64_t next = true_time(CLOCK_MONOTONIC) + (left < WAIT_INTERVAL ? left : WAIT_INTERVAL);
        struct timespec at = {next / SECOND, next % SECOND};
        int result = pthread_cond_clockwait(condition, mutex, CLOCK_MONOTONIC, &at);
        if (result != ETIMEDOUT) return result;
    }
}

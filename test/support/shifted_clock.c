// Copyright 2026 The linkage_vibration authors
// SPDX-License-Identifier: Apache-2.0
//
// Preloaded into a process, this shifts its wall clock (CLOCK_REALTIME) by the nanoseconds in the
// file that SHIFTED_CLOCK names, at any time. As in the kernel, a wait for a time of the wall clock
// lasts until the shifted clock reaches it, and all other clocks run on. Not covered: timerfd.

#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#define SECOND 1000000000LL
#define SLICE (SECOND / 200)  // after which a wait looks at the clock again

typedef struct timespec Time;

static volatile int64_t *offset;

// The waits for a condition until a time of the wall clock. A thread wakes those that are over: a
// wait in slices would miss a signal between two of them.
typedef struct Wait {
  pthread_cond_t *condition;
  const Time *end;
  struct Wait *next;
} Wait;

static Wait *waits;
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static pthread_once_t once = PTHREAD_ONCE_INIT;

__attribute__((constructor)) static void begin(void) {
  int file = open(getenv("SHIFTED_CLOCK"), O_RDONLY);
  offset = mmap(NULL, sizeof *offset, PROT_READ, MAP_SHARED, file, 0);
  if (file < 0 || offset == MAP_FAILED) abort();
  close(file);
}

static int64_t count(const Time *time) { return time->tv_sec * SECOND + time->tv_nsec; }

static Time split(int64_t time) { return (Time){time / SECOND, time % SECOND}; }

int clock_gettime(clockid_t clock, Time *now) {
  int result = syscall(SYS_clock_gettime, clock, now);
  if (!result && offset && (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE))
    *now = split(count(now) + *offset);
  return result;
}

int gettimeofday(struct timeval *restrict now, void *restrict zone) {
  Time time;
  (void)zone;
  clock_gettime(CLOCK_REALTIME, &time);
  *now = (struct timeval){time.tv_sec, time.tv_nsec / 1000};
  return 0;
}

time_t time(time_t *now) {
  Time time;
  clock_gettime(CLOCK_REALTIME, &time);
  if (now) *now = time.tv_sec;
  return time.tv_sec;
}

// Returns how long the wall clock still needs, and a steady time after which to look again.
static int64_t left(const Time *end, Time *look) {
  Time now, steady;
  clock_gettime(CLOCK_REALTIME, &now);
  clock_gettime(CLOCK_MONOTONIC, &steady);
  int64_t rest = count(end) - count(&now);
  *look = split(count(&steady) + (rest < 0 ? 0 : rest < SLICE ? rest : SLICE));
  return rest;
}

static void *wake(void *unused) {
  for (;;) {
    Time look;
    pthread_mutex_lock(&lock);
    for (Wait *wait = waits; wait; wait = wait->next)
      if (left(wait->end, &look) <= 0) pthread_cond_broadcast(wait->condition);
    pthread_mutex_unlock(&lock);
    usleep(SLICE / 1000);
  }
  return unused;
}

static void start(void) {
  pthread_t thread;
  if (pthread_create(&thread, NULL, wake, NULL)) abort();
}

int pthread_cond_clockwait(pthread_cond_t *condition, pthread_mutex_t *mutex, clockid_t clock,
                           const Time *end) {
  if (clock != CLOCK_REALTIME) {
    __typeof__(&pthread_cond_clockwait) actual = dlsym(RTLD_NEXT, "pthread_cond_clockwait");
    return actual(condition, mutex, clock, end);
  }
  Time look;
  if (left(end, &look) <= 0) return ETIMEDOUT;
  pthread_once(&once, start);
  Wait wait = {condition, end, NULL}, **link = &waits;
  pthread_mutex_lock(&lock);
  wait.next = waits;
  waits = &wait;
  pthread_mutex_unlock(&lock);
  int result = pthread_cond_wait(condition, mutex);
  pthread_mutex_lock(&lock);
  while (*link != &wait) link = &(*link)->next;
  *link = wait.next;
  pthread_mutex_unlock(&lock);
  return !result && left(end, &look) <= 0 ? ETIMEDOUT : result;
}

// The clock of the condition is not known here, but steady clocks begin when the machine starts.
int pthread_cond_timedwait(pthread_cond_t *condition, pthread_mutex_t *mutex, const Time *end) {
  clockid_t clock = end->tv_sec > 1000000000 ? CLOCK_REALTIME : CLOCK_MONOTONIC;
  return pthread_cond_clockwait(condition, mutex, clock, end);
}

int sem_clockwait(sem_t *semaphore, clockid_t clock, const Time *end) {
  __typeof__(&sem_clockwait) actual = dlsym(RTLD_NEXT, "sem_clockwait");
  if (clock != CLOCK_REALTIME) return actual(semaphore, clock, end);
  for (Time look;;) {
    int64_t rest = left(end, &look);
    int result = actual(semaphore, CLOCK_MONOTONIC, &look);
    if (!result || errno != ETIMEDOUT || rest <= 0) return result;
  }
}

int sem_timedwait(sem_t *semaphore, const Time *end) {
  return sem_clockwait(semaphore, CLOCK_REALTIME, end);
}

int pthread_mutex_clocklock(pthread_mutex_t *mutex, clockid_t clock, const Time *end) {
  __typeof__(&pthread_mutex_clocklock) actual = dlsym(RTLD_NEXT, "pthread_mutex_clocklock");
  if (clock != CLOCK_REALTIME) return actual(mutex, clock, end);
  for (Time look;;) {
    int64_t rest = left(end, &look);
    int result = actual(mutex, CLOCK_MONOTONIC, &look);
    if (result != ETIMEDOUT || rest <= 0) return result;
  }
}

int pthread_mutex_timedlock(pthread_mutex_t *mutex, const Time *end) {
  return pthread_mutex_clocklock(mutex, CLOCK_REALTIME, end);
}

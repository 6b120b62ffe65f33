/* Copyright 2026 The linkage_vibration authors
 * SPDX-License-Identifier: Apache-2.0
 * Lets one call of the C library fail; it is loaded before the C library (LD_PRELOAD).
 * Calls count below a folder only. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/types.h>
#include <unistd.h>

enum { NONE, OPEN, WRITE, FSYNC, RENAME };
static int kind = NONE;
static long left = 0;
static char below[4096];

void failing_arm(int which, long nth, const char *folder)
{
    strncpy(below, folder, sizeof below - 1);
    left = nth;
    kind = which;
}

/* Whether the call was reached that had to fail. */
int failing_done(void)
{
    return left <= 0;
}

static int fails(int which, int code)
{
    if (kind != which || --left != 0)
        return 0;
    errno = code;
    return 1;
}

static int is_below(const char *path)
{
    char *full;
    int inside;
    if (kind == NONE || !path)
        return 0;
    if (path[0] == '/')
        return strncmp(path, below, strlen(below)) == 0;
    full = getcwd(NULL, 0);
    inside = full && strncmp(full, below, strlen(below)) == 0;
    free(full);
    return inside;
}

static int is_below_fd(int fd)
{
    char link[64], path[4096];
    ssize_t size;
    if (kind == NONE)
        return 0;
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    size = readlink(link, path, sizeof path - 1);
    if (size < 0)
        return 0;
    path[size] = 0;
    return path[0] == '/' && is_below(path);
}

#define REAL(type, name, ...)                                    \
    static type (*real)(__VA_ARGS__);                            \
    if (!real)                                                   \
    real = (type(*)(__VA_ARGS__))dlsym(RTLD_NEXT, #name)

#define OPENS(name)                                              \
    int name(const char *path, int flags, ...)                   \
    {                                                            \
        va_list rest;                                            \
        mode_t mode;                                             \
        REAL(int, name, const char *, int, ...);                 \
        va_start(rest, flags);                                   \
        mode = va_arg(rest, mode_t);                             \
        va_end(rest);                                            \
        if (is_below(path) && fails(OPEN, EACCES))               \
            return -1;                                           \
        return real(path, flags, mode);                          \
    }
OPENS(open)
OPENS(open64)

ssize_t write(int fd, const void *data, size_t size)
{
    REAL(ssize_t, write, int, const void *, size_t);
    if (is_below_fd(fd) && fails(WRITE, ENOSPC))
        return -1;
    return real(fd, data, size);
}

int fsync(int fd)
{
    REAL(int, fsync, int);
    if (is_below_fd(fd) && fails(FSYNC, EIO))
        return -1;
    return real(fd);
}

int rename(const char *from, const char *to)
{
    REAL(int, rename, const char *, const char *);
    if (is_below(from) && fails(RENAME, EIO))
        return -1;
    return real(from, to);
}

int link(const char *from, const char *to)
{
    REAL(int, link, const char *, const char *);
    if (is_below(from) && fails(RENAME, EIO))
        return -1;
    return real(from, to);
}

int linkat(int a, const char *from, int b, const char *to, int flags)
{
    REAL(int, linkat, int, const char *, int, const char *, int);
    if (is_below(from) && fails(RENAME, EIO))
        return -1;
    return real(a, from, b, to, flags);
}

/* Counts the calls that change files below a folder, and kills the process group at one of them.
 *
 * Loaded by LD_PRELOAD. TREADLINK_KILL_STATE names a file that processes share: `struct state`. The call `kill_at`, counted
 * from 1 over all of them, is carried out and then followed by a signal; with `torn` a write is carried out by half. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

struct state {
    int64_t calls, kill_at, torn, signal;
    char folder[1024], last[256];
};

static struct state *state;

__attribute__((constructor)) static void map_state(void) {
    const char *path = getenv("TREADLINK_KILL_STATE");
    int file = path ? open(path, O_RDWR | O_CLOEXEC) : -1;
    if (file < 0) return;
    void *page = mmap(NULL, sizeof *state, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (page != MAP_FAILED) state = page;
    close(file);
}

#define REAL(name) \
    static __typeof__(name) *real; \
    if (!real) real = (__typeof__(name) *)dlsym(RTLD_NEXT, #name)

static int is_below(const char *path) {
    size_t size = strlen(state->folder);
    return size && strncmp(path, state->folder, size) == 0 && path[size] == '/';
}

static int concerns(int folder, const char *path) {
    char whole[PATH_MAX + 64], name[64], at[PATH_MAX];
    if (!state || !state->folder[0]) return 0;
    if (path && path[0] == '/') return is_below(path);
    if (folder == AT_FDCWD) {
        if (!getcwd(at, sizeof at)) return 0;
    } else {
        snprintf(name, sizeof name, "/proc/self/fd/%d", folder);
        ssize_t size = readlink(name, at, sizeof at - 1);
        if (size <= 0) return 0;
        at[size] = 0;
    }
    snprintf(whole, sizeof whole, "%s/%s", at, path ? path : "");
    return is_below(whole);
}

/* Return whether this is the call to die at. */
static int counted(const char *call, int descriptor, const char *path) {
    char name[64], at[PATH_MAX];
    int64_t number = __atomic_add_fetch(&state->calls, 1, __ATOMIC_SEQ_CST);
    if (number != state->kill_at) return 0;
    if (!path) {
        snprintf(name, sizeof name, "/proc/self/fd/%d", descriptor);
        ssize_t size = readlink(name, at, sizeof at - 1);
        at[size > 0 ? size : 0] = 0;
        path = at;
    }
    if (is_below(path)) path += strlen(state->folder) + 1;
    snprintf(state->last, sizeof state->last, "%s %.200s", call, path);
    return 1;
}

static void die(void) {
    kill(0, (int)state->signal);
    while (state->signal == SIGKILL) pause();
}

#define AFTER(call, descriptor, path, expression) \
    int is_counted = concerns(descriptor, path); \
    int is_last = is_counted && counted(call, descriptor, path); \
    __typeof__(expression) result = (expression); \
    if (is_last) die(); \
    return result

static int is_torn(int is_last, size_t size) { return is_last && state->torn && size > 1; }

ssize_t write(int file, const void *data, size_t size) {
    REAL(write);
    int is_last = concerns(file, NULL) && counted("write", file, NULL);
    ssize_t done = real(file, data, is_torn(is_last, size) ? size / 2 : size);
    if (is_last) die();
    return done;
}

ssize_t pwrite(int file, const void *data, size_t size, off_t offset) {
    REAL(pwrite);
    int is_last = concerns(file, NULL) && counted("pwrite", file, NULL);
    ssize_t done = real(file, data, is_torn(is_last, size) ? size / 2 : size, offset);
    if (is_last) die();
    return done;
}

ssize_t pwrite64(int file, const void *data, size_t size, off64_t offset) { return pwrite(file, data, size, offset); }

ssize_t writev(int file, const struct iovec *parts, int count) {
    REAL(writev);
    AFTER("writev", file, NULL, real(file, parts, count));
}

ssize_t copy_file_range(int from, off64_t *from_at, int to, off64_t *to_at, size_t size, unsigned flags) {
    REAL(copy_file_range);
    AFTER("copy_file_range", to, NULL, real(from, from_at, to, to_at, size, flags));
}

ssize_t sendfile(int to, int from, off_t *offset, size_t size);
ssize_t sendfile(int to, int from, off_t *offset, size_t size) {
    REAL(sendfile);
    AFTER("sendfile", to, NULL, real(to, from, offset, size));
}

int fsync(int file) {
    REAL(fsync);
    AFTER("fsync", file, NULL, real(file));
}

int fdatasync(int file) {
    REAL(fdatasync);
    AFTER("fdatasync", file, NULL, real(file));
}

int ftruncate(int file, off_t size) {
    REAL(ftruncate);
    AFTER("truncate", file, NULL, real(file, size));
}

int ftruncate64(int file, off64_t size) { return ftruncate(file, size); }

int rename(const char *old, const char *new) {
    REAL(rename);
    AFTER("rename to", AT_FDCWD, new, real(old, new));
}

int renameat(int old_folder, const char *old, int new_folder, const char *new) {
    REAL(renameat);
    AFTER("rename to", new_folder, new, real(old_folder, old, new_folder, new));
}

int link(const char *old, const char *new) {
    REAL(link);
    AFTER("link", AT_FDCWD, new, real(old, new));
}

int linkat(int old_folder, const char *old, int new_folder, const char *new, int flags) {
    REAL(linkat);
    AFTER("link", new_folder, new, real(old_folder, old, new_folder, new, flags));
}

int symlink(const char *to, const char *path) {
    REAL(symlink);
    AFTER("symlink", AT_FDCWD, path, real(to, path));
}

int unlink(const char *path) {
    REAL(unlink);
    AFTER("unlink", AT_FDCWD, path, real(path));
}

int unlinkat(int folder, const char *path, int flags) {
    REAL(unlinkat);
    AFTER("unlink", folder, path, real(folder, path, flags));
}

int mkdir(const char *path, mode_t mode) {
    REAL(mkdir);
    AFTER("mkdir", AT_FDCWD, path, real(path, mode));
}

int rmdir(const char *path) {
    REAL(rmdir);
    AFTER("rmdir", AT_FDCWD, path, real(path));
}

static mode_t mode_of(int flags, va_list rest) { return flags & (O_CREAT | O_TMPFILE) ? va_arg(rest, mode_t) : 0; }

static int changes(int flags) { return flags & (O_CREAT | O_TRUNC); }

int open(const char *path, int flags, ...) {
    REAL(open);
    va_list rest;
    va_start(rest, flags);
    mode_t mode = mode_of(flags, rest);
    va_end(rest);
    if (!changes(flags)) return real(path, flags, mode);
    AFTER("create", AT_FDCWD, path, real(path, flags, mode));
}

int open64(const char *path, int flags, ...) {
    REAL(open64);
    va_list rest;
    va_start(rest, flags);
    mode_t mode = mode_of(flags, rest);
    va_end(rest);
    if (!changes(flags)) return real(path, flags, mode);
    AFTER("create", AT_FDCWD, path, real(path, flags, mode));
}

int openat(int folder, const char *path, int flags, ...) {
    REAL(openat);
    va_list rest;
    va_start(rest, flags);
    mode_t mode = mode_of(flags, rest);
    va_end(rest);
    if (!changes(flags)) return real(folder, path, flags, mode);
    AFTER("create", folder, path, real(folder, path, flags, mode));
}

/* Records what a process does to the files below a folder, in the order in which it happens, as an LD_PRELOAD library.
 *
 * HD_IO_ROOT names the folder, HD_IO_LOG the file that the records go to. A record is: operation (1 byte), inode
 * (uint64), number (uint64), length of the first and of the second text (uint32 each), both texts. Operations:
 *
 *   C create file (path)          M make folder (path)      U remove file (path)        X remove folder (path)
 *   R rename (old, new)           T set length (number)     W write at number (data)
 *   s begin of a sync             S end of a sync           (number tells which two belong together)
 *   A mark (text), from hd_mark
 *
 * The end of a sync vouches for what came before its beginning alone.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

static pthread_mutex_t lock = PTHREAD_RECURSIVE_MUTEX_INITIALIZER_NP;
static char root[PATH_MAX];
static int log_fd = -1;
static uint64_t syncs;

#define REAL(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))

__attribute__((constructor)) static void begin(void) {
    const char *folder = getenv("HD_IO_ROOT"), *file = getenv("HD_IO_LOG");
    if (!folder || !file || !realpath(folder, root)) return;
    log_fd = REAL(open)(file, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
}

static void record(char op, uint64_t inode, uint64_t number, const void *a, uint32_t na, const void *b, uint32_t nb) {
    char head[25];
    head[0] = op;
    memcpy(head + 1, &inode, 8);
    memcpy(head + 9, &number, 8);
    memcpy(head + 17, &na, 4);
    memcpy(head + 21, &nb, 4);
    struct iovec parts[3] = {{head, 25}, {(void *)a, na}, {(void *)b, nb}};
    if (REAL(writev)(log_fd, parts, 3) != (ssize_t)(25 + na + nb)) abort();
}

static int below(const char *path) {
    size_t n = strlen(root);
    return log_fd >= 0 && !strncmp(path, root, n) && (path[n] == '/' || !path[n]);
}

/* Path of a file by name, without following a link at its end; 0 when it is not below the folder. */
static int named(int folder, const char *name, char *out) {
    char parent[PATH_MAX] = "";
    if (log_fd < 0 || !name) return 0;
    if (name[0] != '/') {
        char link[64];
        ssize_t n;
        if (folder == AT_FDCWD) { if (!getcwd(parent, sizeof parent - 2)) return 0; }
        else {
            snprintf(link, sizeof link, "/proc/self/fd/%d", folder);
            if ((n = readlink(link, parent, sizeof parent - 2)) < 0) return 0;
            parent[n] = 0;
        }
        strcat(parent, "/");
    }
    return snprintf(out, PATH_MAX, "%s%s", parent, name) < PATH_MAX && below(out);
}

static int opened(int fd, uint64_t *inode) {
    char link[64], path[PATH_MAX];
    struct stat info;
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t n = readlink(link, path, sizeof path - 1);
    if (n < 0 || fd == log_fd) return 0;
    path[n] = 0;
    if (!below(path) || fstat(fd, &info)) return 0;
    *inode = info.st_ino;
    return 1;
}

static int open_at(int folder, const char *name, int flags, mode_t mode) {
    char path[PATH_MAX];
    struct stat before, after;
    int wanted = named(folder, name, path) && (flags & (O_CREAT | O_TRUNC));
    pthread_mutex_lock(&lock);
    int there = wanted && !lstat(path, &before);
    int fd = REAL(openat)(folder, name, flags, mode);
    if (fd >= 0 && wanted && !fstat(fd, &after) && S_ISREG(after.st_mode)) {
        if (!there) record('C', after.st_ino, 0, path, strlen(path), 0, 0);
        else if (flags & O_TRUNC) record('T', after.st_ino, 0, 0, 0, 0, 0);
    }
    pthread_mutex_unlock(&lock);
    return fd;
}

#define MODE(flags) mode_t mode = 0; if ((flags) & (O_CREAT | O_TMPFILE)) { \
    va_list more; va_start(more, flags); mode = va_arg(more, mode_t); va_end(more); }
int open(const char *name, int flags, ...) { MODE(flags) return open_at(AT_FDCWD, name, flags, mode); }
int open64(const char *name, int flags, ...) { MODE(flags) return open_at(AT_FDCWD, name, flags, mode); }
int openat(int folder, const char *name, int flags, ...) { MODE(flags) return open_at(folder, name, flags, mode); }
int openat64(int folder, const char *name, int flags, ...) { MODE(flags) return open_at(folder, name, flags, mode); }
int creat(const char *name, mode_t mode) { return open_at(AT_FDCWD, name, O_WRONLY | O_CREAT | O_TRUNC, mode); }

ssize_t write(int fd, const void *data, size_t size) {
    uint64_t inode;
    if (!opened(fd, &inode)) return REAL(write)(fd, data, size);
    pthread_mutex_lock(&lock);
    ssize_t done = REAL(write)(fd, data, size);
    if (done > 0) record('W', inode, lseek(fd, 0, SEEK_CUR) - done, data, done, 0, 0);
    pthread_mutex_unlock(&lock);
    return done;
}

ssize_t writev(int fd, const struct iovec *parts, int count) {
    uint64_t inode;
    if (!opened(fd, &inode)) return REAL(writev)(fd, parts, count);
    ssize_t all = 0;
    for (int i = 0; i < count; i++) {
        ssize_t done = parts[i].iov_len ? write(fd, parts[i].iov_base, parts[i].iov_len) : 0;
        if (done < 0) return all ? all : done;
        all += done;
        if ((size_t)done < parts[i].iov_len) break;
    }
    return all;
}

static ssize_t write_at(int fd, const void *data, size_t size, off64_t place) {
    uint64_t inode;
    int known = opened(fd, &inode);
    pthread_mutex_lock(&lock);
    ssize_t done = REAL(pwrite64)(fd, data, size, place);
    if (known && done > 0) record('W', inode, place, data, done, 0, 0);
    pthread_mutex_unlock(&lock);
    return done;
}
ssize_t pwrite(int fd, const void *data, size_t size, off_t place) { return write_at(fd, data, size, place); }
ssize_t pwrite64(int fd, const void *data, size_t size, off64_t place) { return write_at(fd, data, size, place); }

static int set_length(int fd, off64_t size) {
    uint64_t inode;
    int known = opened(fd, &inode);
    pthread_mutex_lock(&lock);
    int code = REAL(ftruncate64)(fd, size);
    if (known && !code) record('T', inode, size, 0, 0, 0, 0);
    pthread_mutex_unlock(&lock);
    return code;
}
int ftruncate(int fd, off_t size) { return set_length(fd, size); }
int ftruncate64(int fd, off64_t size) { return set_length(fd, size); }

static int set_length_of(const char *name, off64_t size) {
    int fd = open(name, O_WRONLY | O_CLOEXEC);
    if (fd < 0) return -1;
    int code = set_length(fd, size);
    close(fd);
    return code;
}
int truncate(const char *name, off_t size) { return set_length_of(name, size); }
int truncate64(const char *name, off64_t size) { return set_length_of(name, size); }

static int sync_with(int fd, int (*real)(int)) {
    uint64_t inode, own;
    if (!opened(fd, &inode)) return real(fd);
    pthread_mutex_lock(&lock);
    own = ++syncs;
    record('s', inode, own, 0, 0, 0, 0);
    pthread_mutex_unlock(&lock);
    int code = real(fd);
    pthread_mutex_lock(&lock);
    if (!code) record('S', inode, own, 0, 0, 0, 0);
    pthread_mutex_unlock(&lock);
    return code;
}
int fsync(int fd) { return sync_with(fd, REAL(fsync)); }
int fdatasync(int fd) { return sync_with(fd, REAL(fdatasync)); }

int renameat(int from, const char *old, int to, const char *new) {
    char a[PATH_MAX], b[PATH_MAX];
    int known = named(from, old, a) & named(to, new, b);
    pthread_mutex_lock(&lock);
    int code = REAL(renameat)(from, old, to, new);
    if (known && !code) record('R', 0, 0, a, strlen(a), b, strlen(b));
    pthread_mutex_unlock(&lock);
    return code;
}
int rename(const char *old, const char *new) { return renameat(AT_FDCWD, old, AT_FDCWD, new); }

int unlinkat(int folder, const char *name, int flags) {
    char path[PATH_MAX];
    int known = named(folder, name, path);
    pthread_mutex_lock(&lock);
    int code = REAL(unlinkat)(folder, name, flags);
    if (known && !code) record(flags & AT_REMOVEDIR ? 'X' : 'U', 0, 0, path, strlen(path), 0, 0);
    pthread_mutex_unlock(&lock);
    return code;
}
int unlink(const char *name) { return unlinkat(AT_FDCWD, name, 0); }
int rmdir(const char *name) { return unlinkat(AT_FDCWD, name, AT_REMOVEDIR); }

int mkdirat(int folder, const char *name, mode_t mode) {
    char path[PATH_MAX];
    struct stat info;
    int known = named(folder, name, path);
    pthread_mutex_lock(&lock);
    int code = REAL(mkdirat)(folder, name, mode);
    if (known && !code && !lstat(path, &info)) record('M', info.st_ino, 0, path, strlen(path), 0, 0);
    pthread_mutex_unlock(&lock);
    return code;
}
int mkdir(const char *name, mode_t mode) { return mkdirat(AT_FDCWD, name, mode); }

void hd_mark(const char *text) {
    if (log_fd < 0) return;
    pthread_mutex_lock(&lock);
    record('A', 0, 0, text, strlen(text), 0, 0);
    pthread_mutex_unlock(&lock);
}

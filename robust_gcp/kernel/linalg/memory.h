// Where arrays lie: in the system's memory, or in a block that was taken beforehand, for motions that may ask for none.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <new>

namespace rg {

constexpr std::size_t CACHE_LINE = 64;

// One block, handed out in whole cache lines and taken back by size, for one thread at a time. What was handed out of
// one size serves that size again; nothing is joined or divided, so that a motion which repeats itself asks no more.
class Budget {
  public:
    explicit Budget(std::size_t bytes) : size_(bytes / CACHE_LINE * CACHE_LINE), block_(size_ > 0 ? fresh(size_) : nullptr) {
        for (std::size_t at = 0; at < size_; at += 1024) block_.get()[at] = 0;  // no page is missing later
    }

    void* take(std::size_t bytes) {
        const std::size_t k = kind(bytes + sizeof(Head)), whole = width(k);
        Head* head = free_[k];
        if (head != nullptr) {
            free_[k] = head->next;
        } else {
            if (whole > size_ - used_) throw std::bad_alloc();
            head = reinterpret_cast<Head*>(block_.get() + used_);
            used_ += whole;
        }
        head->kind = k;
        return reinterpret_cast<unsigned char*>(head) + sizeof(Head);
    }

    void give(void* p) {
        Head* head = reinterpret_cast<Head*>(static_cast<unsigned char*>(p) - sizeof(Head));
        const std::size_t k = head->kind;
        head->next = free_[k];
        free_[k] = head;
    }

    bool holds(const void* p) const {
        return reinterpret_cast<std::uintptr_t>(p) - reinterpret_cast<std::uintptr_t>(block_.get()) < size_;
    }

    std::size_t used() const { return used_; }

  private:
    struct alignas(CACHE_LINE) Head {
        union {
            std::size_t kind;
            Head* next;
        };
    };
    static constexpr std::size_t LINES = 64, KINDS = LINES + 40;  // up to LINES lines each its own, then powers of two

    static std::size_t kind(std::size_t bytes) {
        const std::size_t lines = (bytes + CACHE_LINE - 1) / CACHE_LINE;
        if (lines <= LINES) return lines;
        std::size_t k = LINES;
        while (width(k) < bytes)
            if (++k == KINDS) throw std::bad_alloc();
        return k;
    }
    static std::size_t width(std::size_t k) { return k <= LINES ? k * CACHE_LINE : (LINES * CACHE_LINE) << (k - LINES); }

    static unsigned char* fresh(std::size_t bytes) {
        void* block = nullptr;
        if (posix_memalign(&block, CACHE_LINE, bytes) != 0) throw std::bad_alloc();
        return static_cast<unsigned char*>(block);
    }
    struct Freed {
        void operator()(unsigned char* p) const { std::free(p); }
    };

    const std::size_t size_;
    const std::unique_ptr<unsigned char, Freed> block_;
    std::size_t used_ = 0;
    std::array<Head*, KINDS> free_{};
};

inline thread_local Budget* budget = nullptr;  // that this thread takes from at present

// Takes from a budget while it lives; null leaves all as it is.
class Within {
  public:
    explicit Within(Budget* of) : before_(budget) {
        if (of != nullptr) budget = of;
    }
    ~Within() { budget = before_; }
    Within(const Within&) = delete;
    Within& operator=(const Within&) = delete;

  private:
    Budget* const before_;
};

// As malloc and free, of whole cache lines where `aligned`; never null. Inline, they would be in each destructor.
void* take(std::size_t bytes, bool aligned);
void give(void* p) noexcept;

}  // namespace rg

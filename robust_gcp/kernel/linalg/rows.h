// Sums of rows of numbers, in registers as far as these hold them.
#pragma once

#include <cstddef>
#include <vector>

namespace rg {

struct Share {
    double share;
    const double* row;
};

constexpr std::size_t WIDE = 8;  // columns, which registers hold

// own = (own + Σ share row) times, in columns `begin` to `end`.
inline void combine(double* own, std::size_t begin, std::size_t end, const Share* first, const Share* last,
                    double times) {
    typedef double Pair __attribute__((vector_size(16), aligned(8), may_alias));
    std::size_t c = begin;
    for (; c + WIDE <= end; c += WIDE) {
        Pair* to = reinterpret_cast<Pair*>(own + c);
        Pair a = to[0], b = to[1], d = to[2], e = to[3];
        for (const Share* from = first; from != last; ++from) {
            const Pair* x = reinterpret_cast<const Pair*>(from->row + c);
            a += from->share * x[0], b += from->share * x[1], d += from->share * x[2], e += from->share * x[3];
        }
        to[0] = times * a, to[1] = times * b, to[2] = times * d, to[3] = times * e;
    }
    for (; c + 6 <= end; c += 6) {
        Pair* to = reinterpret_cast<Pair*>(own + c);
        Pair a = to[0], b = to[1], d = to[2];
        for (const Share* from = first; from != last; ++from) {
            const Pair* x = reinterpret_cast<const Pair*>(from->row + c);
            a += from->share * x[0], b += from->share * x[1], d += from->share * x[2];
        }
        to[0] = times * a, to[1] = times * b, to[2] = times * d;
    }
    for (; c + 4 <= end; c += 4) {
        Pair* to = reinterpret_cast<Pair*>(own + c);
        Pair a = to[0], b = to[1];
        for (const Share* from = first; from != last; ++from) {
            const Pair* x = reinterpret_cast<const Pair*>(from->row + c);
            a += from->share * x[0], b += from->share * x[1];
        }
        to[0] = times * a, to[1] = times * b;
    }
    for (; c + 2 <= end; c += 2) {
        Pair& to = *reinterpret_cast<Pair*>(own + c);
        Pair sum = to;
        for (const Share* from = first; from != last; ++from)
            sum += from->share * *reinterpret_cast<const Pair*>(from->row + c);
        to = times * sum;
    }
    for (; c < end; ++c) {
        double sum = own[c];
        for (const Share* from = first; from != last; ++from) sum += from->share * from->row[c];
        own[c] = times * sum;
    }
}

// The rows that a sum is of.
class Shares {
  public:
    explicit Shares(std::size_t most = 0) : list_(most) {}

    void add(double share, const double* row) {
        if (share != 0.0) list_[count_++] = {share, row};
    }
    void into(double* own, std::size_t begin, std::size_t end, double times = 1.0) const {
        combine(own, begin, end, list_.data(), list_.data() + count_, times);
    }
    void clear() { count_ = 0; }

  private:
    std::vector<Share> list_;
    std::size_t count_ = 0;
};

}  // namespace rg

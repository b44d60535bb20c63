// A mechanism from the bytes of an .rgcp file: structs of abi.h as they lie in memory, with places in the file where
// pointers are. Every place and every index in it is looked at once, here; see export/image.py.
#pragma once

#include <cstdint>
#include <cstring>
#include <map>
#include <stdexcept>
#include <vector>

#include "abi.h"
#include "public/checked.h"

namespace rg {

class Image {
  public:
    Image(const unsigned char* bytes, std::size_t size) {
        Head head;
        if (size < sizeof head) throw std::runtime_error("the file ends too early");
        std::memcpy(&head, bytes, sizeof head);
        if (std::memcmp(head.magic, "RGCP", 4) != 0) throw std::runtime_error("this is no mechanism of robust_gcp");
        if (head.version != VERSION || head.reserved != 0 || head.width != sizeof(Description) + sizeof(Cluster) + sizeof(Exported))
            throw std::runtime_error("the file was written for another version of the library: export it again");
        const std::size_t rest = size - sizeof head;
        if (head.size > rest || head.size % 8 != 0 || head.places > rest / sizeof(Place) ||
            head.size + head.places * sizeof(Place) != rest)
            throw std::runtime_error("the file ends too early, or goes on too long");
        if (checksum(bytes + sizeof head, rest) != head.checksum)
            throw std::runtime_error("the file was damaged: its checksum is another one");
        data_.resize(head.size / 8 + 1);
        char* const begin = reinterpret_cast<char*>(data_.data());
        std::memcpy(begin, bytes + sizeof head, head.size);
        for (std::uint64_t k = 0; k < head.places; ++k) {
            Place place;
            std::memcpy(&place, bytes + sizeof head + head.size + k * sizeof place, sizeof place);
            if (place.at % 8 != 0 || place.at > head.size - 8 || place.to % 8 != 0 || place.to > head.size ||
                place.size > head.size - place.to)
                throw std::runtime_error("the file is damaged: it points beyond its end");
            const char* to = begin + place.to;
            std::memcpy(begin + place.at, &to, sizeof to);
            extents_[to] = std::max(extents_[to], place.size);
        }
        if (head.root % 8 != 0 || head.root > head.size || head.size - head.root < sizeof(Exported))
            throw std::runtime_error("the file is damaged: nothing is described");
        root_ = reinterpret_cast<const Exported*>(begin + head.root);
        Checked(extents_).exported(*root_);
    }

    const Exported& root() const { return *root_; }

  private:
    struct Head {
        char magic[4];
        std::uint32_t version, width, reserved;
        std::uint64_t size, places, root, checksum;
    };
    struct Place {
        std::uint64_t at, to, size;
    };

    // FNV-1a, of 64 bits.
    static std::uint64_t checksum(const unsigned char* bytes, std::size_t size) {
        std::uint64_t sum = 14695981039346656037u;
        for (std::size_t i = 0; i < size; ++i) sum = (sum ^ bytes[i]) * 1099511628211u;
        return sum;
    }

    std::vector<double> data_;
    std::map<const void*, std::uint64_t> extents_;  // how many bytes there are at each place that is pointed to
    const Exported* root_ = nullptr;
};

}  // namespace rg

// Sets of track ids.

#include <algorithm>

#include "stages.hpp"

namespace core {

Array<bool, 1> among(const Indices& ids, const Indices& known) {
    Array<bool, 1> result({ids.shape[0]});
    for (std::size_t i = 0; i < ids.shape[0]; i++)
        result.data[i] = std::binary_search(known.data, known.data + known.shape[0], ids.data[i]);
    return result;
}

}  // namespace core

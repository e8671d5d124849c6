// Sets of track ids.

#include <algorithm>
#include <vector>

#include "stages.hpp"

namespace core {

Array<bool, 1> among(Indices ids, Indices known) {
    Array<bool, 1> result(ids.shape[0]);
    Lookup among_known{known};
    for (std::size_t i = 0; i < ids.shape[0]; i++) result.data[i] = among_known.row(ids.data[i]) != NONE;
    return result;
}

Array<std::int64_t, 1> times_among(Indices ids, Indices others, Flags counted) {
    require_shape(counted, {others.shape[0]}, "counted");
    Array<std::int64_t, 1> result(ids.shape[0]);
    Lookup rows{ids};
    for (std::size_t i = 0; i < others.shape[0]; i++)
        if (std::size_t at = counted.data[i] ? rows.row(others.data[i]) : NONE; at != NONE) result.data[at]++;
    return result;
}

Array<std::int64_t, 1> union_of(Indices ids) {
    std::vector<std::int64_t> sorted(ids.data, ids.data + ids.shape[0]);
    std::sort(sorted.begin(), sorted.end());
    sorted.erase(std::unique(sorted.begin(), sorted.end()), sorted.end());
    Array<std::int64_t, 1> result(sorted.size());
    std::copy(sorted.begin(), sorted.end(), result.data.get());
    return result;
}

}  // namespace core

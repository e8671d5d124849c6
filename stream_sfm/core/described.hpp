// The names in the stub of records that several families take.
#pragma once

#include "binding.hpp"
#include "records.hpp"

namespace binding {

DESCRIBED(Pinholes, "Pinholes")
DESCRIBED(Field, "Field")
DESCRIBED(RowModel, "Rows")
DESCRIBED(RightSides, "RightSides")
DESCRIBED(ExposedRows, "ExposedRows")
DESCRIBED(Timing, "Timing")
DESCRIBED(TemplateConfig, "TemplateConfig")
DESCRIBED(ViewNoise, "ViewNoise")
DESCRIBED(TemplateKind, "TemplateKind")
DESCRIBED(TrackTable, "Tracks")
DESCRIBED(PointViews, "Views")

}  // namespace binding

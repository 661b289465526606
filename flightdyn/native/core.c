/* The functions of one level. */

#include "control.h"
#include "cruise.h"
#include "error_state.h"
#include "guidance.h"
#include "landing.h"
#include "levelled.h"
#include "strapdown.h"

const Flight NAMED(flight) = {integrate, carry, transition, innovate,
                               reference, guide, land, cruise};

"""Whether Stone Soup is there: imported before anything that needs it."""

from gmr_gym.recorded.extras import module_of

STONE_SOUP = module_of("stonesoup", "stonesoup.base", "gmr_gym.stonesoup")

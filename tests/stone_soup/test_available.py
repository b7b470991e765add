"""Where Stone Soup is not installed, the bridge says which command installs it."""

import subprocess
import sys


def test_without_stone_soup_the_command_that_installs_it_is_given():
    code = (
        "import sys\n"
        "sys.modules['stonesoup'] = sys.modules['stonesoup.base'] = None\n"
        "import gmr_gym\n"
        "try:\n"
        "    import gmr_gym.stonesoup\n"
        "except ImportError as error:\n"
        "    print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    needs = "gmr_gym.stonesoup needs the extra `stonesoup`: pip install 'gmr-gym[stonesoup]'\n"
    assert (done.stdout, done.returncode) == (needs, 0), done.stderr

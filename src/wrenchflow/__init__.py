"""wrenchflow: contact-rich robot tasks, from the operator's hand to a policy that does them."""

__version__ = "0.1.0"

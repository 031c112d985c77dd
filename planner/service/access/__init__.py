"""Who may do what: tokens, browser logins, rights by scope, and what browsers are told to refuse."""
